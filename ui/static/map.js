// The pool from above in {E}: x to the right, y downwards, psi clockwise, as the camera sees it.

import { DEG, fixed } from "./format.js";
import { curves } from "./route.js";

const TRAIL_S = 60;
const DRAG_PX = 12;
const GRAB_PX = 14; // so near to a way-point a press takes it
const BOW = 1.25; // as drawn, in radii
const [WIDE, HIGH] = [34, 42]; // room for the numbers at the walls, in px
export const COLOURS = { estimate: "#4fc3df", reference: "#f2b84b", truth: "#a99bf5", push: "#ff8a65", thrust: "#8ee6a4" };

export class PoolMap {
  constructor(store, system, reference, route) {
    Object.assign(this, { store, system, reference, route });
    this.canvas = document.querySelector("#map");
    this.context = this.canvas.getContext("2d");
    this.listen();
    this.listenForRoute();
    route.changed = () => this.draw();
    new ResizeObserver(() => this.resize()).observe(this.canvas);
  }

  // --- geometry

  resize() {
    const { length_x_m, length_y_m } = this.system.pool;
    this.canvas.style.height = `${((this.canvas.clientWidth - WIDE) * length_y_m) / length_x_m + HIGH}px`;
    this.draw();
  }

  fit() {
    const { length_x_m, length_y_m } = this.system.pool;
    const { clientWidth: width, clientHeight: height } = this.canvas;
    this.scale = Math.min((width - WIDE) / length_x_m, (height - HIGH) / length_y_m);
    this.left = (width - WIDE - length_x_m * this.scale) / 2 + 24;
    this.top = 8;
  }

  px(x_m) {
    return this.left + x_m * this.scale;
  }

  py(y_m) {
    return this.top + y_m * this.scale;
  }

  worldToClient(x_m, y_m) {
    this.fit();
    const box = this.canvas.getBoundingClientRect();
    return { x: box.left + this.px(x_m), y: box.top + this.py(y_m) };
  }

  clientToWorld(event) {
    const box = this.canvas.getBoundingClientRect();
    return { x_m: (event.clientX - box.left - this.left) / this.scale, y_m: (event.clientY - box.top - this.top) / this.scale };
  }

  // --- choosing a place: click sets it, drag from it sets the heading, the wheel turns it

  listen() {
    let from = null;
    this.canvas.addEventListener("pointerdown", (event) => {
      if (event.button > 0 || this.route.editing) return;
      from = event;
      this.canvas.setPointerCapture(event.pointerId);
      const psi_rad = (this.reference.chosen ?? this.reference.current())?.psi_rad ?? 0;
      this.reference.choose({ ...this.clientToWorld(event), psi_rad });
      this.draw();
    });
    this.canvas.addEventListener("pointermove", (event) => {
      if (!from || event.pointerId !== from.pointerId) return;
      const [dx, dy] = [event.clientX - from.clientX, event.clientY - from.clientY];
      if (Math.hypot(dx, dy) < DRAG_PX) return;
      this.reference.turnTo(Math.atan2(dy, dx) * DEG);
      this.draw();
    });
    for (const end of ["pointerup", "pointercancel"]) this.canvas.addEventListener(end, () => (from = null));
    this.canvas.addEventListener("wheel", (event) => {
      if (!this.reference.chosen) return;
      event.preventDefault();
      this.reference.turnTo(this.reference.chosen.psi_rad * DEG + 5 * Math.sign(event.deltaY));
      this.draw();
    }, { passive: false });
  }

  // --- way-points: a press sets one or takes one to move it, a double click or the right button deletes it

  listenForRoute() {
    let taken = -1;
    const near = (event) => {
      const box = this.canvas.getBoundingClientRect();
      const off = (p) => Math.hypot(this.px(p.x_m) - event.clientX + box.left, this.py(p.y_m) - event.clientY + box.top);
      return this.route.points.findIndex((p) => off(p) < GRAB_PX);
    };
    const remove = (event) => {
      const index = this.route.editing ? near(event) : -1;
      if (index < 0) return;
      event.preventDefault();
      taken = -1;
      this.route.remove(index);
    };
    this.canvas.addEventListener("pointerdown", (event) => {
      if (!this.route.editing || event.button > 0) return;
      this.canvas.setPointerCapture(event.pointerId);
      taken = near(event);
      if (taken < 0) taken = this.route.add(this.clientToWorld(event));
    });
    this.canvas.addEventListener("pointermove", (event) => taken >= 0 && this.route.move(taken, this.clientToWorld(event)));
    for (const end of ["pointerup", "pointercancel"]) this.canvas.addEventListener(end, () => (taken = -1));
    this.canvas.addEventListener("dblclick", remove);
    this.canvas.addEventListener("contextmenu", remove);
  }

  // --- drawing

  draw() {
    const ratio = devicePixelRatio || 1;
    const { canvas, context: c } = this;
    const [width, height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    this.fit();
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.clearRect(0, 0, width, height);
    this.drawPool(c);
    this.drawTrail(c);
    const state = this.store.get("navigation/state");
    const helm = this.store.fresh("helm/state", 1.5);
    const held = helm?.mode !== "stop" && helm?.x_m != null && helm?.y_m != null ? helm : null;
    if (helm?.points?.length > 1) this.drawFollowed(c, helm);
    if (this.route.points.length) this.drawRoute(c, this.route.points, this.route.smooth, { dash: [6, 5], numbers: true });
    if (held && state) this.drawLeg(c, state, held);
    if (held) this.drawShape(c, held, { stroke: COLOURS.reference, width: 2 });
    if (helm && helm.mode !== "stop") this.drawMoving(c, helm, held);
    const truth = this.store.fresh("simulation/truth", 1);
    if (truth) this.drawShape(c, truth, { stroke: COLOURS.truth, width: 1.2, alpha: 0.6 });
    if (state) this.drawVessel(c, state);
    if (this.reference.chosen) this.drawShape(c, this.reference.chosen, { stroke: COLOURS.reference, width: 2, dash: [6, 5], cross: true });
  }

  drawPool(c) {
    const { length_x_m, length_y_m } = this.system.pool;
    const [width, height] = [length_x_m * this.scale, length_y_m * this.scale];
    const water = c.createRadialGradient(this.px(length_x_m / 2), this.py(length_y_m / 2), 0, this.px(length_x_m / 2), this.py(length_y_m / 2), width * 0.7);
    water.addColorStop(0, "#10303d");
    water.addColorStop(1, "#0c2430");
    c.fillStyle = water;
    c.fillRect(this.left, this.top, width, height);
    c.font = "11px system-ui, sans-serif";
    c.textAlign = "center";
    c.textBaseline = "middle";
    const half = gridStep(Math.max(length_x_m, length_y_m)) / 2;
    for (const vertical of [true, false]) {
      const length = vertical ? length_x_m : length_y_m;
      for (let i = 0; i * half <= length + 1e-9; i++) {
        const at = vertical ? this.px(i * half) : this.py(i * half);
        c.strokeStyle = i % 2 ? "rgba(140,190,210,0.07)" : "rgba(140,190,210,0.16)";
        line(c, vertical ? [at, this.top, at, this.top + height] : [this.left, at, this.left + width, at]);
        if (i % 2) continue;
        c.fillStyle = "#7f97a5";
        if (vertical) c.fillText(String(i * half), at, this.top + height + 12);
        else c.fillText(String(i * half), this.left - 11, at);
      }
    }
    c.fillText("x, m", this.px(length_x_m) - 10, this.top + height + 25);
    c.fillText("y, m", this.left + 20, this.py(length_y_m) - 10);
    c.strokeStyle = "#3c6474";
    c.lineWidth = 2;
    c.strokeRect(this.left, this.top, width, height);
  }

  drawTrail(c) {
    const track = this.store.variables.get("navigation/state");
    const [xs, ys] = [track?.series.get("x_m"), track?.series.get("y_m")];
    if (!xs || !ys) return;
    const end = track.times.at(-1);
    const chunks = 6;
    let index = track.times.findIndex((t) => t > end - TRAIL_S);
    c.strokeStyle = COLOURS.estimate;
    c.lineWidth = 1.6;
    for (let chunk = 1; chunk <= chunks; chunk++) {
      c.globalAlpha = (0.7 * chunk) / chunks;
      c.beginPath();
      for (const until = end - TRAIL_S * (1 - chunk / chunks); index < xs.length; index += 2) {
        c.lineTo(this.px(xs[index]), this.py(ys[index]));
        if (track.times[index] > until) break;
      }
      c.stroke();
    }
    c.globalAlpha = 1;
  }

  /** What the controller tells of the request in force. */
  told(helm) {
    const told = this.store.fresh("control/status", 1);
    return told?.request_id === helm.request_id ? told : null;
  }

  /** The path in force: the present leg bold. */
  drawFollowed(c, helm) {
    this.drawRoute(c, helm.points, helm.smooth, { leg: this.told(helm)?.leg });
  }

  /** The reference of this moment, on its way along a path or to the place that is held. */
  drawMoving(c, helm, held) {
    const { reference_x_m: x_m, reference_y_m: y_m, reference_psi_rad: psi_rad } = this.told(helm) ?? {};
    if (x_m == null || (held && Math.hypot(held.x_m - x_m, held.y_m - y_m) < 0.02)) return;
    this.drawShape(c, { x_m, y_m, psi_rad }, { stroke: COLOURS.reference, width: 1.5, alpha: 0.6 });
  }

  drawRoute(c, points, smooth, { leg = null, dash = [], numbers = false }) {
    c.strokeStyle = c.fillStyle = COLOURS.reference;
    c.setLineDash(dash);
    const at = (p) => [this.px(p.x_m), this.py(p.y_m)];
    curves(points, smooth).forEach(([from, first, second, to], index) => {
      c.lineWidth = index === leg ? 3.5 : 1.5;
      c.beginPath();
      c.moveTo(...at(from));
      c.bezierCurveTo(...at(first), ...at(second), ...at(to));
      c.stroke();
    });
    c.setLineDash([]);
    points.forEach((point, index) => {
      const [x, y] = at(point);
      c.beginPath();
      c.arc(x, y, numbers ? 7 : 4, 0, 7);
      c.fill();
      if (!numbers) return;
      c.fillStyle = "#1b1508";
      c.fillText(String(index + 1), x, y);
      c.fillStyle = COLOURS.reference;
    });
  }

  drawLeg(c, from, to) {
    c.strokeStyle = COLOURS.reference;
    c.globalAlpha = 0.5;
    c.setLineDash([2, 5]);
    line(c, [this.px(from.x_m), this.py(from.y_m), this.px(to.x_m), this.py(to.y_m)]);
    c.setLineDash([]);
    c.globalAlpha = 1;
  }

  /** Work in the vessel's frame {B}, in metres: x forward, y to starboard. */
  inBody(c, pose, work) {
    c.save();
    c.translate(this.px(pose.x_m), this.py(pose.y_m));
    c.rotate(pose.psi_rad);
    c.scale(this.scale, this.scale);
    work();
    c.restore();
  }

  hull(c) {
    const r = this.system.radius_m;
    const flank = Math.acos(1 / BOW); // where the tangents from the bow touch the round hull
    c.beginPath();
    c.moveTo(r * BOW, 0);
    c.arc(0, 0, r, flank, 2 * Math.PI - flank);
    c.closePath();
  }

  drawShape(c, pose, { stroke, width, alpha = 1, dash = [], cross = false }) {
    this.inBody(c, pose, () => {
      c.globalAlpha = alpha;
      c.strokeStyle = stroke;
      c.lineWidth = width / this.scale;
      c.setLineDash(dash.map((d) => d / this.scale));
      this.hull(c);
      c.stroke();
      c.setLineDash([]);
      const r = this.system.radius_m;
      line(c, cross ? [-r * 0.35, 0, r * 0.9, 0] : [r * 0.55, 0, r * 0.95, 0]);
      if (cross) line(c, [0, -r * 0.35, 0, r * 0.35]);
    });
  }

  drawVessel(c, state) {
    const lost = state.status === "lost" || state.status === "initialising" || !this.store.fresh("navigation/state", 1);
    this.inBody(c, state, () => {
      this.hull(c);
      c.fillStyle = lost ? "rgba(120,130,140,0.35)" : "rgba(79,195,223,0.22)";
      c.fill();
      c.strokeStyle = lost ? "#84919b" : COLOURS.estimate;
      c.lineWidth = 2 / this.scale;
      c.stroke();
      const r = this.system.radius_m;
      line(c, [0, 0, r * 1.05, 0]);
      this.drawThrusters(c);
    });
    c.fillStyle = lost ? "#84919b" : COLOURS.estimate;
    c.beginPath();
    c.arc(this.px(state.x_m), this.py(state.y_m), 3, 0, 7);
    c.fill();
    this.drawPush(c, state);
  }

  /** Arrows along the force of each thruster on the vessel, full length at full command; a cross on one left out, a ring on one said to fail. */
  drawThrusters(c) {
    const commands = this.store.fresh("actuator/command", 1)?.commands ?? {};
    const { failed = {}, lost = {} } = this.store.get("actuator/health") ?? {};
    const full = this.system.radius_m * 0.9;
    for (const { name, x_m, y_m, angle_rad, n_max } of this.system.thrusters) {
      c.fillStyle = "#56707e";
      c.beginPath();
      c.arc(x_m, y_m, 0.025, 0, 7);
      c.fill();
      c.strokeStyle = "#ff5d5d";
      c.lineWidth = 2.5 / this.scale;
      if (lost[name] && !failed[name]) {
        c.beginPath();
        c.arc(x_m, y_m, 0.07, 0, 7);
        c.stroke();
      }
      if (failed[name]) {
        const d = 0.06;
        line(c, [x_m - d, y_m - d, x_m + d, y_m + d]);
        line(c, [x_m - d, y_m + d, x_m + d, y_m - d]);
      }
      const part = (commands[name] ?? 0) / n_max;
      if (Math.abs(part) < 0.02) continue;
      const angle = part > 0 ? angle_rad : angle_rad + Math.PI;
      arrow(c, x_m, y_m, angle, full * Math.abs(part), COLOURS.thrust, 2 / this.scale, 6 / this.scale);
    }
  }

  /** The estimated disturbance; its length grows with the root, so that a small one is still seen. */
  drawPush(c, { x_m, y_m, disturbance_x_n: fx, disturbance_y_n: fy }) {
    const force = Math.hypot(fx ?? 0, fy ?? 0);
    if (force < 0.005) return;
    const strongest = Math.max(force, ...this.system.thrusters.map((t) => t.max_n));
    const length = this.scale * this.system.radius_m * (0.8 + 2 * Math.sqrt(Math.min(1, force / strongest)));
    const angle = Math.atan2(fy, fx);
    const [x, y] = [this.px(x_m), this.py(y_m)];
    arrow(c, x, y, angle, length, COLOURS.push, 2, 8);
    c.fillStyle = COLOURS.push;
    c.fillText(`${fixed(force, force < 0.1 ? 3 : 2)} N`, x + Math.cos(angle) * (length + 24), y + Math.sin(angle) * (length + 14));
  }
}

/** Distance of numbered lines in m: 1 in a pool, 1, 2 or 5 times a power of ten where the water is wide. */
function gridStep(length_m) {
  const rough = length_m / 12;
  if (rough <= 1) return 1;
  const power = 10 ** Math.floor(Math.log10(rough));
  return power * [1, 2, 5, 10].find((m) => power * m >= rough);
}

function line(c, [x1, y1, x2, y2]) {
  c.beginPath();
  c.moveTo(x1, y1);
  c.lineTo(x2, y2);
  c.stroke();
}

function arrow(c, x, y, angle, length, colour, width, head) {
  c.save();
  c.translate(x, y);
  c.rotate(angle);
  c.strokeStyle = c.fillStyle = colour;
  c.lineWidth = width;
  line(c, [0, 0, Math.max(0, length - head), 0]);
  c.beginPath();
  c.moveTo(length, 0);
  c.lineTo(length - head, head * 0.5);
  c.lineTo(length - head, -head * 0.5);
  c.fill();
  c.restore();
}
