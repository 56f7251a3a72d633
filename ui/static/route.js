// Way-points on the map: set, moved and deleted there, before the helm knows of them; and how a path is drawn.

import { text } from "./format.js";

export class Route {
  constructor(system) {
    this.system = system;
    this.points = [];
    this.editing = false;
    this.changed = () => {};
    const find = (name) => document.querySelector(`#route-${name}`);
    [this.editButton, this.followButton, this.clearButton] = ["edit", "follow", "clear"].map(find);
    [this.smoothBox, this.speedField] = ["smooth", "speed"].map(find);
    this.editButton.onclick = () => this.edit(!this.editing);
    this.clearButton.onclick = () => this.clear();
    this.smoothBox.onchange = () => this.show();
    addEventListener("keydown", (event) => {
      if (this.editing && event.code === "Backspace" && !event.target.matches?.("input")) this.remove(this.points.length - 1);
    });
    this.show();
  }

  get smooth() {
    return this.smoothBox.checked && this.points.length > 2;
  }

  /** Mode and reference to ask for: one way-point is a line from here, two are a line. */
  get wish() {
    const speed = this.speedField.valueAsNumber;
    const reference = { points: this.points, smooth: this.smooth };
    if (Number.isFinite(speed)) reference.speed_m_s = speed;
    return [this.points.length > 2 ? "path" : "line", reference];
  }

  edit(editing) {
    this.editing = editing;
    this.show();
  }

  clear() {
    this.points = [];
    this.edit(false);
  }

  add(place) {
    if (this.points.length < 100) this.points.push(this.inside(place));
    this.show();
    return this.points.length - 1;
  }

  move(index, place) {
    this.points[index] = this.inside(place);
    this.show();
  }

  remove(index) {
    this.points = this.points.filter((_, i) => i !== index);
    this.show();
  }

  inside({ x_m, y_m }) {
    const { pool, radius_m } = this.system;
    const within = (value, length) => Number(Math.max(radius_m, Math.min(length - radius_m, value)).toFixed(3));
    return { x_m: within(x_m, pool.length_x_m), y_m: within(y_m, pool.length_y_m) };
  }

  show() {
    this.editButton.setAttribute("aria-pressed", this.editing);
    this.followButton.disabled = this.clearButton.disabled = !this.points.length;
    text(this.followButton, this.points.length > 2 ? "Follow path" : "Follow line");
    this.changed();
  }
}

/** Bezier curves [from, control, control, to] of a path's legs: straight, or the natural spline of marine.guidance.course. */
export function curves(points, smooth) {
  const lengths = points.slice(1).map((p, k) => Math.hypot(p.x_m - points[k].x_m, p.y_m - points[k].y_m) || 1e-9);
  const bend = { x_m: seconds(points, lengths, "x_m", smooth), y_m: seconds(points, lengths, "y_m", smooth) };
  return lengths.map((h, k) => {
    const [a, b] = [points[k], points[k + 1]];
    const control = (from, sign, near, far) => {
      const at = (axis) => from[axis] + (sign * (b[axis] - a[axis])) / 3 - (h * h * (2 * bend[axis][near] + bend[axis][far])) / 18;
      return { x_m: at("x_m"), y_m: at("y_m") };
    };
    return [a, control(a, 1, k, k + 1), control(b, -1, k + 1, k), b];
  });
}

/** Second derivatives of one coordinate at the way-points, zero at both ends: a tridiagonal system. */
function seconds(points, lengths, axis, smooth) {
  const values = points.map((p) => p[axis]);
  const result = values.map(() => 0);
  if (!smooth) return result;
  const [c, d] = [[0], [0]];
  for (let i = 1; i < values.length - 1; i++) {
    const [before, after] = [lengths[i - 1], lengths[i]];
    const right = 6 * ((values[i + 1] - values[i]) / after - (values[i] - values[i - 1]) / before);
    const pivot = 2 * (before + after) - before * c[i - 1];
    c[i] = after / pivot;
    d[i] = (right - before * d[i - 1]) / pivot;
  }
  for (let i = values.length - 2; i > 0; i--) result[i] = d[i] - c[i] * result[i + 1];
  return result;
}
