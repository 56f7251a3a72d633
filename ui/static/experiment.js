// Identification experiments: what to do, how it goes, what came out. Stop and Hold end one at any time.

import { DEG, fixed, h, text } from "./format.js";

const NAMES = ["self-oscillation", "zigzag", "step", "pull-out", "prbs"];
const TURNING = ["self-oscillation", "zigzag"]; // reverse the force at a distance, so many times
const AXES = ["yaw", "surge", "sway", "heave"];
const WIDTH = 420;
const HEIGHT = 150;
const SVG = "http://www.w3.org/2000/svg";

export class Experiment {
  constructor(helm, store, system) {
    Object.assign(this, { helm, store, shown: "", estimates: [] });
    const choice = (name, label, values) => h("label", {}, h("span", { class: "label" }, label),
      h("select", { name }, ...values.map((value) => h("option", { value }, value))));
    const number = (name, label, value, attributes = {}) => h("label", {}, h("span", { class: "label" }, label),
      h("input", { name, type: "number", value, ...attributes }));
    this.form = h("form", { id: "experiment-form", onsubmit: (event) => this.start(event), onchange: () => this.fit() },
      choice("name", "experiment", NAMES), choice("axis", "axis", AXES.filter((axis) => system.axes.includes(axis))),
      choice("direction", "first push", ["+", "-"]), number("amplitude", "force, % of the most", "50", { min: 1, max: 100 }),
      number("hysteresis", "", "", { step: "any", placeholder: "chosen for you" }),
      number("oscillations", "oscillations", "5", { min: 2, max: 50 }),
      h("button", { type: "submit", id: "experiment-start" }, "Start"));
    this.fit();
    this.bar = h("progress", { max: "1", value: "0" });
    this.line = h("p", { class: "note", id: "experiment-status" });
    this.advice = h("p", { class: "note" });
    this.live = h("div", { id: "experiment-estimate" });
    this.result = h("div", { id: "experiment-result" });
    document.querySelector("#experiment").append(this.form, this.bar, this.line, this.advice, this.live, this.result);
  }

  /** What the chosen experiment does not use cannot be typed; the place to turn back is an angle or a distance. */
  fit() {
    const { name, axis, hysteresis, oscillations } = this.form.elements;
    const turning = TURNING.includes(name.value);
    for (const input of [hysteresis, oscillations]) input.disabled = !turning;
    text(hysteresis.previousElementSibling, `turn back at, ${axis.value === "yaw" ? "°" : "m"}`);
  }

  start(event) {
    event.preventDefault();
    const given = Object.fromEntries(new FormData(this.form));
    const plan = { name: given.name, axis: given.axis, direction: given.direction === "+" ? 1 : -1,
      amplitude: Number(given.amplitude) / 100 };
    if (given.oscillations) plan.oscillations = Number(given.oscillations);
    if (given.hysteresis && given.axis === "yaw") plan.hysteresis_rad = Number(given.hysteresis) / DEG;
    else if (given.hysteresis) plan.hysteresis_m = Number(given.hysteresis);
    this.helm.ask("experiment", { experiment: plan });
  }

  tick() {
    const status = this.store.get("experiment/status");
    if (status && status.state !== "idle") this.showStatus(status);
    const estimate = this.store.get("experiment/estimate");
    if (estimate && estimate.stamp_ns !== this.estimates.at(-1)?.stamp_ns) this.showEstimate(estimate);
    const result = this.store.get("experiment/result");
    if (result && result.run !== this.shown) this.showResult(result);
  }

  showStatus(status) {
    this.bar.value = status.state === "done" ? 1 : status.progress;
    const yaw = status.unit === "rad";
    const size = (value) => (yaw ? `${fixed(value * DEG, 1)}°` : `${fixed(value, 3)} m`);
    const parts = [`${status.name}, ${status.axis}: ${status.state}`, status.reason];
    if (status.state === "running") parts.push(status.phase, `${fixed(status.elapsed_s, 0)} s`, `${fixed(status.force, 2)} ${yaw ? "Nm" : "N"}`);
    if (status.half_period_s != null) parts.push(`half period ${fixed(status.half_period_s, 2)} s`);
    if (status.amplitude != null) parts.push(`swings ${size(status.amplitude)}, bias ${size(status.bias)}`, `${status.oscillations} in a row`);
    text(this.line, parts.filter(Boolean).join(" · "));
    text(this.advice, status.advice ? `Advice: ${status.advice}` : "");
  }

  /** Recursive least squares while it runs: each parameter with its deviation, and how it came to that. */
  showEstimate(estimate) {
    const first = this.estimates.at(-1);
    if (first && (first.run !== estimate.run || first.axis !== estimate.axis)) this.estimates = [];
    this.estimates = [...this.estimates.slice(-119), estimate];
    const known = this.estimates.filter((e) => e.parameters.length);
    const rows = estimate.parameters.map((p, i) => h("tr", {}, h("td", {}, p.name),
      h("td", {}, `${p.value.toPrecision(4)}${p.std == null ? "" : ` ± ${p.std.toPrecision(2)}`}`), h("td", {}, p.unit),
      h("td", {}, this.history(known.map((e) => e.parameters[i])))));
    this.live.replaceChildren(h("b", {}, `So far: ${estimate.axis}`),
      rows.length ? h("table", {}, h("tbody", {}, ...rows)) : h("p", { class: "note" }, estimate.reason));
  }

  /** Value over time with a band of two deviations; the scale is that of the last third. */
  history(values) {
    const recent = values.slice(Math.floor((2 * values.length) / 3));
    const low = Math.min(...recent.map((p) => p.value - 3 * (p.std ?? 0)));
    const high = Math.max(...recent.map((p) => p.value + 3 * (p.std ?? 0)));
    const x = (i) => (values.length < 2 ? 0 : (i / (values.length - 1)) * 140);
    const y = (v) => Math.min(40, Math.max(0, 40 - ((v - low) / (high - low || 1)) * 40));
    const svg = document.createElementNS(SVG, "svg");
    svg.setAttribute("viewBox", "0 0 140 40");
    svg.setAttribute("width", "140");
    const draw = (tag, points, attributes) => {
      const line = document.createElementNS(SVG, tag);
      line.setAttribute("points", points.map(([a, b]) => `${a},${b}`).join(" "));
      for (const [name, value] of Object.entries(attributes)) line.setAttribute(name, value);
      svg.append(line);
    };
    const edge = (side) => values.map((p, i) => [x(i), y(p.value + side * 2 * (p.std ?? 0))]);
    draw("polygon", [...edge(1), ...edge(-1).reverse()], { fill: "#4fc3df", opacity: "0.25" });
    draw("polyline", values.map((p, i) => [x(i), y(p.value)]), { fill: "none", stroke: "#4fc3df", "stroke-width": 2 });
    return svg;
  }

  showResult(result) {
    this.shown = result.run;
    const rows = result.methods.flatMap((m) => [
      h("tr", {}, h("th", { colspan: "3" }, m.failure ? `${m.method}: ${m.failure}` : `${m.method}, ${m.model}`)),
      ...m.parameters.map((p) => h("tr", {}, h("td", {}, p.name),
        h("td", {}, `${p.value.toPrecision(5)}${p.std == null ? "" : ` ± ${p.std.toPrecision(2)}`}`), h("td", {}, p.unit))),
      ...m.warnings.map((w) => h("tr", {}, h("td", { colspan: "3" }, `warning: ${w}`))),
    ]);
    this.result.replaceChildren(h("b", {}, `Result: ${result.plan.name}, ${result.plan.axis}`), this.plot(result),
      h("table", {}, h("tbody", {}, ...rows)), h("p", { class: "note" }, result.vessel_file ? `Vessel file: ${result.vessel_file}` : ""));
  }

  /** Measured and simulated response as a small picture. */
  plot({ t_s, measured, simulated }) {
    const all = [...measured, ...simulated];
    const [low, high, end] = [Math.min(...all), Math.max(...all), t_s.at(-1) || 1];
    const path = (values, colour) => {
      const line = document.createElementNS(SVG, "polyline");
      line.setAttribute("points", values.map((v, i) => `${(t_s[i] / end) * WIDTH},${HEIGHT - ((v - low) / (high - low || 1)) * HEIGHT}`).join(" "));
      for (const [name, value] of Object.entries({ fill: "none", stroke: colour, "stroke-width": 2 })) line.setAttribute(name, value);
      return line;
    };
    const svg = document.createElementNS(SVG, "svg");
    svg.setAttribute("viewBox", `0 0 ${WIDTH} ${HEIGHT}`);
    svg.append(path(measured, "#4fc3df"), path(simulated, "#f2b84b"));
    return h("figure", { title: "blue: measured, yellow: simulated" }, svg);
  }
}
