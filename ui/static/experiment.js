// Identification experiments: what to do, how it goes, what came out. Stop and Hold end one at any time.

import { DEG, fixed, h, text } from "./format.js";

const NAMES = ["self-oscillation", "zigzag", "step", "pull-out", "prbs"];
const WIDTH = 420;
const HEIGHT = 150;
const SVG = "http://www.w3.org/2000/svg";

export class Experiment {
  constructor(helm, store) {
    Object.assign(this, { helm, store, shown: "" });
    const choice = (name, label, values) => h("label", {}, h("span", { class: "label" }, label),
      h("select", { name }, ...values.map((value) => h("option", { value }, value))));
    const number = (name, label, value, attributes = {}) => h("label", {}, h("span", { class: "label" }, label),
      h("input", { name, type: "number", value, ...attributes }));
    this.form = h("form", { class: "fault", id: "experiment-form", onsubmit: (event) => this.start(event) },
      h("div", { class: "inputs" }, choice("name", "experiment", NAMES), choice("axis", "axis", ["yaw", "surge", "sway"]),
        choice("direction", "first push", ["+", "-"])),
      h("div", { class: "inputs" }, number("amplitude", "force, % of the largest", "50", { min: 1, max: 100 }),
        number("hysteresis", "reverse at, ° or m", "", { step: "any", placeholder: "chosen" }),
        number("oscillations", "oscillations", "5", { min: 2, max: 50 })),
      h("button", { type: "submit", id: "experiment-start" }, "Start"));
    this.bar = h("progress", { max: "1", value: "0" });
    this.line = h("p", { class: "note", id: "experiment-status" });
    this.advice = h("p", { class: "note" });
    this.result = h("div", { id: "experiment-result" });
    document.querySelector("#experiment").append(this.form, this.bar, this.line, this.advice, this.result);
  }

  start(event) {
    event.preventDefault();
    const given = Object.fromEntries(new FormData(this.form));
    const plan = { name: given.name, axis: given.axis, direction: given.direction === "+" ? 1 : -1,
      amplitude: Number(given.amplitude) / 100, oscillations: Number(given.oscillations) };
    if (given.hysteresis && given.axis === "yaw") plan.hysteresis_rad = Number(given.hysteresis) / DEG;
    else if (given.hysteresis) plan.hysteresis_m = Number(given.hysteresis);
    this.helm.ask("experiment", { experiment: plan });
  }

  tick() {
    const status = this.store.get("experiment/status");
    if (status && status.state !== "idle") this.showStatus(status);
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
