// The place and heading the operator has chosen, before the helm knows of it.

import { DEG, fixed, wrapDeg } from "./format.js";

const PLACE = ["x_m", "y_m"];

const round = (value, digits) => Number(value.toFixed(digits));

export class Reference {
  /** `current()` gives {x_m, y_m, psi_rad} to start from: the acting reference or the vessel's pose. */
  constructor(system, current) {
    this.system = system;
    this.current = current;
    this.chosen = null;
    this.limits = {}; // by axis: what the walls allow where it is not what was asked for
    this.fields = { x_m: this.field("#ref-x", "x_m"), y_m: this.field("#ref-y", "y_m"), psi_deg: this.field("#ref-psi", "psi_deg") };
    this.clearButton = document.querySelector("#ref-clear");
    this.clearButton.onclick = () => this.clear();
    document.querySelector("#reference").onsubmit = (event) => {
      event.preventDefault();
      document.activeElement?.blur();
    };
  }

  field(selector, name) {
    const input = document.querySelector(selector);
    input.addEventListener("input", () => this.readFields(name));
    input.addEventListener("change", () => this.chosen && this.write(this.chosen, true));
    return input;
  }

  choose(pose) {
    this.keepInside(pose, PLACE);
    this.write(this.chosen);
  }

  /** Choose a pose as near to it as the walls allow; what they said of numbers that are not `given` now still holds. */
  keepInside({ x_m, y_m, psi_rad }, given) {
    const { pool, radius_m } = this.system;
    const inside = (name, value, length) => {
      const kept = round(Math.max(radius_m, Math.min(length - radius_m, value)), 3);
      const limited = Math.abs(kept - value) > 1e-3;
      if (given.includes(name)) this.limits[name] = limited && `${name[0]} ${fixed(radius_m, 2)} … ${fixed(length - radius_m, 2)} m`;
      return kept;
    };
    this.chosen = { x_m: inside("x_m", x_m, pool.length_x_m), y_m: inside("y_m", y_m, pool.length_y_m), psi_rad };
    this.clearButton.disabled = false;
  }

  clear() {
    this.chosen = null;
    this.limits = {};
    this.clearButton.disabled = true;
    this.follow();
  }

  /** Choose another heading at the chosen place. */
  turnTo(deg) {
    this.chosen = { ...this.chosen, psi_rad: wrapDeg(Math.round(deg)) / DEG };
    this.write(this.chosen);
  }

  readFields(typed) {
    const base = this.chosen ?? this.current();
    if (!base) return;
    const { x_m, y_m, psi_deg } = this.fields;
    const value = (input, fallback) => (Number.isFinite(input.valueAsNumber) ? input.valueAsNumber : fallback);
    const pose = { x_m: value(x_m, base.x_m), y_m: value(y_m, base.y_m), psi_rad: wrapDeg(value(psi_deg, base.psi_rad * DEG)) / DEG };
    this.keepInside(pose, this.chosen ? [typed] : PLACE);
  }

  write({ x_m, y_m, psi_rad }, typed = false) {
    const show = (input, value) => (typed || document.activeElement !== input) && (input.value = value);
    const metres = (value) => Number(round(value, 3).toPrecision(6)); // what the field has room for, on a lake too
    show(this.fields.x_m, metres(x_m));
    show(this.fields.y_m, metres(y_m));
    show(this.fields.psi_deg, round(psi_rad * DEG, 1));
  }

  /** While nothing is chosen the fields show what is in force. */
  follow() {
    const acting = this.chosen ? null : this.current();
    if (acting) this.write(acting);
  }

  describe() {
    const { x_m, y_m, psi_rad } = this.chosen;
    const limits = PLACE.map((name) => this.limits[name]).filter(Boolean).join(", ");
    return `${fixed(x_m, 2)} m, ${fixed(y_m, 2)} m, ${fixed(psi_rad * DEG, 0)}°${limits && ` (limited by the walls to ${limits})`}`;
  }
}
