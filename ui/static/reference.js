// The place and heading the operator has chosen, before the helm knows of it.

import { DEG, fixed, wrapDeg } from "./format.js";

const round = (value, digits) => Number(value.toFixed(digits));

export class Reference {
  /** `current()` gives {x_m, y_m, psi_rad} to start from: the acting reference or the vessel's pose. */
  constructor(system, current) {
    this.system = system;
    this.current = current;
    this.chosen = null;
    this.fields = { x_m: this.field("#ref-x"), y_m: this.field("#ref-y"), psi_deg: this.field("#ref-psi") };
    this.clearButton = document.querySelector("#ref-clear");
    this.clearButton.onclick = () => this.clear();
    document.querySelector("#reference").onsubmit = (event) => {
      event.preventDefault();
      document.activeElement?.blur();
    };
  }

  field(selector) {
    const input = document.querySelector(selector);
    input.addEventListener("input", () => this.readFields());
    return input;
  }

  choose(pose) {
    const { pool, radius_m } = this.system;
    const inside = (value, length) => round(Math.max(radius_m, Math.min(length - radius_m, value)), 3);
    this.chosen = {
      x_m: inside(pose.x_m, pool.length_x_m),
      y_m: inside(pose.y_m, pool.length_y_m),
      psi_rad: pose.psi_rad,
    };
    this.write(this.chosen);
    this.clearButton.disabled = false;
  }

  clear() {
    this.chosen = null;
    this.clearButton.disabled = true;
    this.follow();
  }

  turn(deg) {
    const psi = wrapDeg(Math.round(this.chosen.psi_rad * DEG + deg));
    this.choose({ ...this.chosen, psi_rad: psi / DEG });
  }

  readFields() {
    const base = this.chosen ?? this.current();
    if (!base) return;
    const { x_m, y_m, psi_deg } = this.fields;
    const value = (input, fallback) => (Number.isFinite(input.valueAsNumber) ? input.valueAsNumber : fallback);
    const { pool, radius_m } = this.system;
    const inside = (v, length) => Math.max(radius_m, Math.min(length - radius_m, v));
    this.chosen = {
      x_m: inside(value(x_m, base.x_m), pool.length_x_m),
      y_m: inside(value(y_m, base.y_m), pool.length_y_m),
      psi_rad: wrapDeg(value(psi_deg, base.psi_rad * DEG)) / DEG,
    };
    this.clearButton.disabled = false;
  }

  write({ x_m, y_m, psi_rad }) {
    const show = (input, value) => document.activeElement !== input && (input.value = value);
    show(this.fields.x_m, round(x_m, 3));
    show(this.fields.y_m, round(y_m, 3));
    show(this.fields.psi_deg, round(psi_rad * DEG, 1));
  }

  /** While nothing is chosen the fields show what is in force. */
  follow() {
    const acting = this.chosen ? null : this.current();
    if (acting) this.write(acting);
  }

  describe() {
    const { x_m, y_m, psi_rad } = this.chosen;
    return `${fixed(x_m, 2)} m, ${fixed(y_m, 2)} m, ${fixed(psi_rad * DEG, 0)}°`;
  }
}
