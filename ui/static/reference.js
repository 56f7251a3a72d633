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
    input.addEventListener("change", () => this.chosen && this.write(this.chosen, true));
    return input;
  }

  choose(pose) {
    this.keepInside(pose);
    this.write(this.chosen);
  }

  /** Choose a pose as near to it as the walls allow; `limit` says what they allow when it is not that. */
  keepInside({ x_m, y_m, psi_rad }) {
    const { pool, radius_m } = this.system;
    const inside = (value, length) => round(Math.max(radius_m, Math.min(length - radius_m, value)), 3);
    this.chosen = { x_m: inside(x_m, pool.length_x_m), y_m: inside(y_m, pool.length_y_m), psi_rad };
    const room = (length) => `${fixed(radius_m, 2)} … ${fixed(length - radius_m, 2)} m`;
    const moved = Math.hypot(this.chosen.x_m - x_m, this.chosen.y_m - y_m) > 1e-3;
    this.limit = moved ? `x ${room(pool.length_x_m)}, y ${room(pool.length_y_m)}` : "";
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
    this.keepInside({ x_m: value(x_m, base.x_m), y_m: value(y_m, base.y_m), psi_rad: wrapDeg(value(psi_deg, base.psi_rad * DEG)) / DEG });
  }

  write({ x_m, y_m, psi_rad }, typed = false) {
    const show = (input, value) => (typed || document.activeElement !== input) && (input.value = value);
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
    const limit = this.limit ? ` (limited by the walls to ${this.limit})` : "";
    return `${fixed(x_m, 2)} m, ${fixed(y_m, 2)} m, ${fixed(psi_rad * DEG, 0)}°${limit}`;
  }
}
