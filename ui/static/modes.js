// Modes besides manual and hold that this vessel can: heading, speed, depth.

import { h } from "./format.js";

const MODES = [
  { mode: "heading", label: "Heading", needs: ["yaw"], turns: true, title: "Keep the chosen heading, or that of now; the stick has the rest" },
  { mode: "speed", label: "Speed", needs: ["surge", "yaw"], turns: true, title: "Ahead at this speed (empty: that of now), on the chosen heading or that of now",
    field: { name: "speed_m_s", unit: "m/s", step: 0.05 } },
  { mode: "depth", label: "Depth", needs: ["heave"], sensor: "depth", title: "Keep this depth (empty: that of now); the stick has the rest",
    field: { name: "z_m", unit: "m", step: 0.1, min: 0 } },
];

export class Modes {
  constructor(helm, reference, system) {
    Object.assign(this, { helm, reference });
    const can = MODES.filter(({ needs, sensor }) => needs.every((axis) => system.axes.includes(axis)) && (!sensor || system.sensors.includes(sensor)));
    this.buttons = can.map((mode) => this.row(mode));
  }

  row({ mode, label, title, field, turns }) {
    const input = field && h("input", { id: `ref-${mode}`, type: "number", inputmode: "decimal", step: field.step, ...(field.min === undefined ? {} : { min: field.min }),
      placeholder: field.unit, "aria-label": `${label}, ${field.unit}` });
    const button = h("button", { type: "submit", id: mode, "aria-pressed": "false", title }, label);
    const ask = (event) => {
      event.preventDefault();
      document.activeElement?.blur();
      const psi_rad = turns ? this.reference.chosen?.psi_rad : undefined;
      this.helm.ask(mode, { ...(psi_rad === undefined ? {} : { psi_rad }), ...(Number.isFinite(input?.valueAsNumber) ? { [field.name]: input.valueAsNumber } : {}) });
    };
    document.querySelector("#more-modes").append(h("form", { onsubmit: ask }, button, ...(input ? [input] : [])));
    return button;
  }

  show() {
    const mode = this.helm.state?.mode;
    for (const button of this.buttons) button.setAttribute("aria-pressed", button.id === mode);
  }
}
