// Faults of the simulated world; the tab exists only where a simulator publishes.

import { h } from "./format.js";
import { toast } from "./toasts.js";

export class Faults {
  constructor(link, store, system) {
    Object.assign(this, { link, store, system });
    this.button = document.querySelector("#faults-button");
    const box = (this.element = document.querySelector("#faults"));
    const numbers = (name, label, value, step) => h("label", {}, h("span", { class: "label" }, label), h("input", { name, type: "number", value, step }));
    const thruster = () => h("select", { name: "thruster", "aria-label": "Thruster" }, ...system.actuators.map((name) => h("option", {}, name)));
    box.append(
      this.row("current", "Current", numbers("x_m_s", "x, m/s", "0.05", "0.01"), numbers("y_m_s", "y, m/s", "0", "0.01")),
      this.row("camera_shift", "Camera shifted", numbers("x_px", "x, px", "10", "1"), numbers("y_px", "y, px", "0", "1")),
      this.row("camera_black", "Black picture"),
      this.row("thruster_dead", "Thruster dead", thruster()),
      this.row("thruster_weak", "Thruster weak", thruster(), numbers("fraction", "lost, 0 to 1", "0.6", "0.1")),
      this.row("thruster_stuck", "Thruster stuck", thruster()),
      ...(system.sensors.includes("laser") ? [this.row("laser_lost", "Laser dots lost")] : []),
      this.row("board", "Calibration board"),
      this.row("dropout", "Frames lost", numbers("fraction", "lost, 0 to 1", "0.5", "0.1")),
      h("button", { type: "button", class: "wide", onclick: () => this.send({ kind: "clear" }, "All faults cleared") }, "Clear all faults"),
    );
  }

  row(kind, title, ...inputs) {
    const form = h("form", { class: "fault", "data-kind": kind, onsubmit: (event) => event.preventDefault() }, h("b", {}, title), h("div", { class: "inputs" }, ...inputs));
    const values = () => Object.fromEntries([...new FormData(form)].map(([name, value]) => [name, name === "thruster" ? value : Number(value)]));
    form.append(
      h("button", { type: "submit", onclick: () => this.send({ kind, ...values() }, `${title}: begins`) }, "Begin"),
      h("button", { type: "button", onclick: () => this.send({ kind, ...values(), active: false }, `${title}: ends`) }, "End"),
    );
    return form;
  }

  send(fault, message) {
    if (this.link.send({ type: "fault", fault })) toast(message);
    else toast("No connection to the server.", { level: "error" });
  }

  tick() {
    this.button.hidden = !this.store.get("simulation/truth");
    const order = this.store.get("simulation/fault");
    if (!order || order.stamp_ns === this.seen) return;
    this.seen = order.stamp_ns;
    for (const form of this.element.querySelectorAll("form"))
      if (["clear", form.dataset.kind].includes(order.kind)) form.dataset.active = order.kind !== "clear" && order.active;
  }
}
