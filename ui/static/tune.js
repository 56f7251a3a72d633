// Tuning: identify an axis, see what a law will do on that model beside the present one, engage it or go back.

import { DEG, fixed, h, text } from "./format.js";
import { toast } from "./toasts.js";

const PLAN = { name: "self-oscillation", amplitude: 0.7, oscillations: 3 };
const ANSWER_MS = 1500;
const ROWS = [
  ["aside", "overshoot_percent", "pushed aside: overshoots, %", 1],
  ["aside", "settling_s", "back within 5 % after, s", 1],
  ["step", "overshoot_percent", "new reference: overshoots, %", 1],
  ["step", "settling_s", "within 5 % after, s", 1],
  ["aside", "saturated_s", "at the actuators' limit, s", 1],
  ["aside", "actuator_activity", "actuators' way (IADC), N or Nm", 2],
  ["margins", "phase_deg", "phase margin, °", 0],
  ["margins", "delay_s", "delay margin, s", 2],
  ["", "bound_1_s", "β/α must be below (8.23), 1/s", 2],
];
const WIDTH = 200;
const HEIGHT = 90;
const SVG = "http://www.w3.org/2000/svg";

const significant = (value) => Number(value.toPrecision(4));

export class Tune {
  constructor(helm, link, store, system) {
    Object.assign(this, { helm, link, store, system, proposal: null, followed: 0, seen: null, queue: [], asked: 0, waiting: new Map() });
    this.hint = h("p", { id: "tune-hint", role: "status" });
    this.present = h("p", { class: "note", id: "tune-present" });
    this.progress = h("progress", { max: "1", value: "0" });
    this.line = h("p", { class: "note", id: "tune-status" });
    const axes = system.tuned;
    const button = (id, label, run, title = "") => h("button", { type: "button", id, title, onclick: run }, label);
    this.law = h("select", { id: "tune-law", "aria-label": "law", onchange: () => this.choose({ law: this.law.value, parameters: {} }) },
      ...system.laws.map((law) => h("option", { value: law.name, title: law.doc }, law.name)));
    this.doc = h("p", { class: "note" });
    this.fields = h("div", { class: "tune-fields" });
    this.refused = h("p", { class: "refused", id: "tune-refused", role: "alert" });
    this.table = h("div", { id: "tune-table" });
    this.engage = button("tune-engage", "Engage", () => this.ask(this.proposal), "Go on with this law from now on, without a jump");
    this.discard = button("tune-discard", "Discard", () => this.copyPresent());
    this.back = button("tune-back", "Back to before", () => this.ask(this.gains.before));
    this.lines = h("pre");
    this.keep = h("details", { id: "tune-keep", hidden: true },
      h("summary", {}, "Keep it for the next start: these lines of the configuration file"), this.lines);
    document.querySelector("#tune").append(
      this.hint, this.present,
      h("div", { class: "tune-buttons" }, ...[...axes].reverse().map((axis) => button(`tune-${axis}`, `Tune ${axis}`, () => this.run([axis]), "Identify by a self-oscillation")),
        ...(axes.length > 1 ? [button("tune-all", "Tune all", () => this.run(["yaw", "surge", "sway"].filter((axis) => axes.includes(axis))))] : [])),
      this.progress, this.line,
      h("div", { class: "tune-law" }, h("label", {}, h("span", { class: "label" }, "law"), this.law), this.fields), this.doc,
      this.refused, h("div", { class: "tune-buttons" }, this.engage, this.discard, this.back), this.keep, this.table);
  }

  get gains() {
    return this.store.get("control/gains");
  }

  // --- identify

  run(axes) {
    this.queue = axes.slice(1);
    this.helm.ask("experiment", { experiment: { ...PLAN, axis: axes[0] } });
  }

  tick() {
    const { gains } = this;
    if (!gains) {
      text(this.present, "The controller does not tell its gains.");
      return;
    }
    if (gains.since_ns !== this.followed) this.follow(gains);
    const result = this.store.get("experiment/result");
    if (result && result.run !== this.seen) this.takeResult(result);
    const status = this.store.get("experiment/status");
    if (status && status.state !== "idle") this.showStatus(status);
    const changed = this.link.open && this.proposal !== null && JSON.stringify(this.proposal) !== JSON.stringify(gains.tuning);
    this.engage.disabled = !changed || Boolean(this.refused.textContent);
    this.discard.disabled = !changed;
    this.back.disabled = !this.link.open || (!gains.before && !gains.engaged);
    if (this.unseen && this.link.open) this.preview();
    text(this.hint, this.next(gains, status?.state, changed));
    const lines = this.configuration(gains);
    text(this.lines, lines);
    this.keep.hidden = !lines;
  }

  /** What there is to do now, in a sentence. */
  next(gains, state, changed) {
    const holds = this.system.tuned.length > 1;
    const place = !this.helm.holdButton.hidden;
    if (["running", "identifying"].includes(state))
      return `The vessel ${holds ? "swings to and fro about its place, half a minute to a minute" : "goes ahead and weaves for a minute or two"}. STOP ends it. Nothing is changed by it.`;
    const found = Object.entries(this.proposal?.models ?? {}).filter(([axis, model]) => JSON.stringify(model) !== JSON.stringify(gains.tuning.models[axis]));
    if (this.refused.textContent) return "Not like this: change law or parameters, or Discard.";
    if (found.length) {
      const told = found.map(([axis, { alpha }]) => `${axis}: inertia ${significant(alpha)} instead of ${significant(gains.tuning.models[axis].alpha)}`);
      return `Found ${told.join("; ")}. Engage goes on with it, without a jump; until then nothing has changed.`;
    }
    if (changed) return "Changed here, not on the vessel: Engage takes it over, Discard forgets it.";
    if (gains.engaged) return `In force. ${place ? "Hold keeps a place" : "Speed and lines keep a heading"} with it; Back to before undoes it.`;
    return `Unknown vessel, three clicks: Tune identifies it (it swings for ${holds ? "half a minute an axis" : "a minute or two"}), Engage takes over what was found, ${place ? "Hold" : "Speed"}.`;
  }

  /** The lines of a configuration file that make what was engaged last: empty when the file has it already. */
  configuration({ tuning, configured, engaged }) {
    if (!engaged) return "";
    const value = (one) => (typeof one === "string" ? JSON.stringify(one) : one);
    const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);
    const law = this.system.laws.find((one) => one.name === tuning.law);
    const before = tuning.law === configured.law ? configured.parameters : Object.fromEntries(law.parameters.map((p) => [p.name, p.default]));
    const other = Object.entries(tuning.parameters).filter(([name, one]) => one !== null && !same(one, before[name]));
    const file = /^engaged models: (.*)$/.exec(this.store.get("service/experiment/heartbeat")?.note ?? "")?.[1];
    const lines = same(tuning.models, configured.models) ? [] : ["[system]", file ? `vessel = ${JSON.stringify(file)}` : "# vessel = ... : no file was written, the note of experiment in Services says why"];
    if (law.serves === "positioning") {
      if (tuning.law !== configured.law) lines.push("[controller]", `positioning = ${JSON.stringify(tuning.law)}`);
      if (other.length) lines.push(`[controller.laws.${tuning.law}]`, ...other.map(([name, one]) => `${name} = ${value(one)}`));
    } else if (other.length) {
      lines.push("[controller]", ...other.map(([name, one]) => `${name === "structure" ? "heading" : "heading_w0_rad_s"} = ${value(one)}`));
    }
    return lines.join("\n");
  }

  showStatus(status) {
    const running = ["running", "identifying"].includes(status.state);
    this.progress.value = running ? status.progress : status.state === "done" ? 1 : 0;
    const left = this.queue.length ? ` · then ${this.queue.join(", ")}` : "";
    text(this.line, `${status.name} ${status.axis}: ${status.state} · ${fixed(status.elapsed_s, 0)} s${left} ${status.advice || status.reason}`);
    if (status.state === "failed") this.queue = [];
  }

  /** An identification that is newer than what is in force goes into the proposal. */
  takeResult(result) {
    this.seen = result.run;
    const [method] = result.methods;
    const { axis } = result.plan;
    if (method.failure || result.stamp_ns < this.gains.since_ns || !(axis in this.gains.tuning.models)) return;
    const found = Object.fromEntries(method.parameters.map((p) => [p.name, p.value]));
    const model = { alpha: found.alpha, beta: found.beta ?? 0, beta_quadratic: found.beta_quadratic ?? 0 };
    this.choose({ models: { ...this.proposal.models, [axis]: model } });
    if (this.queue.length) this.runNext(result.run);
  }

  /** The next axis, as soon as the helm has ended the last experiment. */
  runNext(run, tries = 40) {
    const state = this.helm.state;
    if (state?.experiment_run === run && tries > 0) setTimeout(() => this.runNext(run, tries - 1), 100);
    else if (state?.mode === "hold") this.run(this.queue);
    else this.queue = [];
  }

  // --- the proposal

  follow(gains) {
    this.followed = gains.since_ns;
    const since = new Date(gains.since_ns / 1e6).toLocaleTimeString();
    const origin = gains.engaged ? `engaged by ${gains.by} at ${since}` : "the configuration file's";
    text(this.present, `In force: ${gains.tuning.law}, ${origin}`);
    this.copyPresent();
  }

  copyPresent() {
    this.proposal = structuredClone(this.gains.tuning);
    this.law.value = this.proposal.law;
    this.choose({});
  }

  choose(change) {
    this.proposal = { ...this.proposal, ...change };
    if (!("parameters" in change) || change.law) this.showFields();
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.preview(), 120);
  }

  /** One input for each parameter of the law; a frequency that the vessel file may give is a slider. */
  showFields() {
    const law = this.system.laws.find((one) => one.name === this.proposal.law);
    text(this.doc, law.doc);
    const set = (name, value) => this.choose({ parameters: { ...this.proposal.parameters, [name]: value } });
    this.fields.replaceChildren(...law.parameters.map(({ name, default: fallback, doc }) => {
      const value = this.proposal.parameters[name] ?? fallback;
      if (typeof fallback === "string") return this.field(name, doc, h("input", { name, value, onchange: (event) => set(name, event.target.value) }));
      if (fallback !== null) {
        return this.field(name, doc, h("input", { name, value, type: "number", step: "any", oninput: (event) => set(name, event.target.valueAsNumber) }));
      }
      const w0 = this.system.w0_rad_s;
      const shown = value ?? this.proposal.parameters.w0_rad_s ?? w0;
      const number = h("output", {}, fixed(shown, 2));
      const slide = (event) => {
        const chosen = significant(w0 * 2 ** event.target.valueAsNumber);
        text(number, fixed(chosen, 2));
        set(name, chosen);
      };
      return this.field(name, doc, h("input", { name, type: "range", min: -2, max: 3, step: 0.05, value: Math.log2(shown / w0), oninput: slide }), number);
    }));
  }

  field(name, doc, ...inputs) {
    const label = name.replace(inputs[1] ? /_rad_s$/ : "", "").replaceAll("_", " ");
    return h("label", { title: doc }, h("span", { class: "label" }, label, ...(inputs[1] ? [" ", inputs[1], " rad/s"] : [])), inputs[0]);
  }

  async preview() {
    const asked = ++this.asked;
    const { tuning, shaping } = this.gains;
    const body = JSON.stringify({ proposed: this.proposal, present: tuning, shaping });
    let found;
    try {
      const answer = await fetch("/api/tuning", { method: "POST", headers: { "Content-Type": "application/json" }, body });
      found = answer.ok ? await answer.json() : { refused: await answer.text(), axes: {} };
    } catch {
      found = null;
    }
    if (asked !== this.asked) return; // the slider has moved on
    this.unseen = !found;
    if (!found) return; // asked again with the next connection
    text(this.refused, found.refused ? `Not allowed: ${found.refused}` : "");
    this.showTable(found.axes);
  }

  showTable(axes) {
    const names = Object.keys(axes);
    const row = (label, value, show, title) => h("tr", {}, h("th", {}, label), ...names.map((axis) => {
      const [present, proposed] = ["present", "proposed"].map((which) => axes[axis][which] && show(value(axes[axis][which], which, axis)));
      const same = present === proposed;
      return h("td", { class: "num", title: title?.(axis) }, ...(same || !present ? [] : [h("span", { class: "present" }, present), " → "]),
        h("b", { class: same ? "present" : "proposed" }, proposed ?? "–"));
    }));
    const digits = (count) => (value) => (value == null ? "–" : fixed(value, count));
    const some = (value) => (value == null ? "–" : String(significant(value)));
    const { configured, tuning } = this.gains;
    const model = (label, key) => row(label, (_, which, axis) => (which === "present" ? tuning : this.proposal).models[axis][key], some,
      (axis) => (this.proposal.models[axis][key] === configured.models[axis][key] ? "vessel file" : "identified"));
    this.table.replaceChildren(
      h("p", { class: "label" }, "Pushed aside: how it comes back, ", h("span", { class: "present" }, "present"), " and ", h("b", { class: "proposed" }, "proposed")),
      h("div", { class: "tune-plots" }, ...names.map((axis) => this.plot(axis, axes[axis]))),
      h("table", {}, h("thead", {}, h("tr", {}, h("th", {}, h("span", { class: "present" }, "present"), " → ", h("b", { class: "proposed" }, "proposed")), ...names.map((axis) => h("th", {}, axis)))), h("tbody", {},
        ...ROWS.map(([part, name, label, count]) => row(label, (found) => (part ? found[part]?.[name] : found[name]),
          name === "settling_s" ? (value) => (value == null ? "never" : fixed(value, count)) : digits(count))),
        model("inertia α, kg or kg m²", "alpha"), model("constant drag", "beta"), model("linear drag", "beta_quadratic"),
        ...["k_i", "k_p", "k_d"].map((key) => row(key.toUpperCase(), (found) => found.gains?.[key], some)))));
  }

  /** How the vessel comes back when it is pushed aside: proposed and present, on the model above. */
  plot(axis, { proposed, present }) {
    const curves = [[present, "#8197a4"], [proposed, "#f2b84b"]].filter(([found]) => found).map(([found, colour]) => [found.aside, colour]);
    const end = Math.max(...curves.map(([c]) => c.dt_s * c.eta.length));
    const { size } = curves[0][0];
    const high = Math.max(1.25 * size, ...curves.flatMap(([c]) => c.eta));
    const y = (value) => HEIGHT * (1 - value / high);
    const svg = document.createElementNS(SVG, "svg");
    svg.setAttribute("viewBox", `0 0 ${WIDTH} ${HEIGHT}`);
    for (const [points, stroke] of [[`0,${y(size)} ${WIDTH},${y(size)}`, "#24323c"], ...curves.map(([c, colour]) => [
      c.eta.map((v, i) => `${((i * c.dt_s) / end) * WIDTH},${y(Math.max(v, -0.2 * size))}`).join(" "), colour])]) {
      const line = document.createElementNS(SVG, "polyline");
      for (const [name, value] of Object.entries({ points, fill: "none", stroke, "stroke-width": 1.5 })) line.setAttribute(name, value);
      svg.append(line);
    }
    const amount = axis === "yaw" ? `${fixed(size * DEG, 0)}°` : `${fixed(size, 1)} m`;
    return h("figure", {}, h("figcaption", { class: "label" }, `${axis}, ${amount} aside, ${fixed(end, 0)} s`), svg);
  }

  // --- consent

  ask(tuning) {
    const request_id = `${this.link.client}-t${Date.now()}`;
    if (!this.link.send({ type: "tuning", request_id, tuning })) {
      toast("No connection to the server.", { level: "error" });
      return;
    }
    this.waiting.set(request_id, tuning);
    setTimeout(() => this.waiting.delete(request_id) && toast("The controller does not answer.", { level: "error" }), ANSWER_MS);
  }

  answered({ request_id, accepted, reason }) {
    if (!this.waiting.delete(request_id)) return;
    if (accepted) toast("Engaged: it takes over without a jump");
    else toast(`Refused: ${reason}`, { level: "error" });
  }
}
