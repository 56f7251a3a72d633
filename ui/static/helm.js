// Modes: asks the helm, shows what it answered and what it does, keeps the lease.

import { DEG, fixed, text } from "./format.js";
import { toast } from "./toasts.js";

const RENEW_MS = 1000;
const ANSWER_MS = 1500;
const THERE_MS = 5000; // so long a wish waits for a helm that is silent
const MINE = "You have the helm";
const NAMES = { stop: "stopped", manual: "manual", hold: "holding", heading: "keeping heading", experiment: "experiment",
  depth: "keeping depth", speed: "keeping speed", line: "following line", path: "following path", distance: "keeping distance" };
const ACCEPTED = { stop: "Stopped", manual: "You have the stick", experiment: "The experiment begins",
  heading: "Keeping the heading", speed: "Keeping the speed", depth: "Keeping the depth",
  distance: "Keeping the distance", line: "Following the line", path: "Following the path" };

/** The wall ahead, of a vessel with a laser module. */
class Wall {
  constructor(store, ask) {
    this.store = store;
    const find = (id) => document.querySelector(id);
    [this.form, this.distance, this.angle, this.wanted, this.button] = ["#wall", "#wall-distance", "#wall-angle", "#ref-distance", "#distance"].map(find);
    this.form.onsubmit = (event) => {
      event.preventDefault();
      document.activeElement?.blur();
      ask(Number.isFinite(this.wanted.valueAsNumber) ? { distance_m: this.wanted.valueAsNumber } : {});
    };
  }

  show(mode) {
    const wall = this.store.fresh("navigation/wall", 1.5);
    if (wall) this.form.hidden = false;
    text(this.distance, fixed(wall?.distance_m, 2));
    text(this.angle, fixed(wall?.angle_rad == null ? null : wall.angle_rad * DEG, 0));
    this.form.dataset.status = wall?.status ?? "lost";
    this.button.setAttribute("aria-pressed", mode === "distance");
  }
}

export class Helm {
  constructor(link, store, reference, route, system) {
    Object.assign(this, { link, store, reference, route });
    this.waiting = new Map(); // request_id -> {mode, reference}
    this.later = null; // the wish that waits for a silent helm
    this.requests = 0;
    this.renewedAt = 0;
    this.modeOutput = document.querySelector("#mode");
    this.manualButton = document.querySelector("#manual");
    this.holdButton = document.querySelector("#hold");
    this.guardNote = document.querySelector("#guard");
    this.wall = new Wall(store, (wish) => this.ask("distance", wish));
    route.followButton.onclick = () => this.ask(...route.wish);
    this.leaseNote = document.querySelector("#lease");
    document.querySelector("#stop").onclick = () => this.stop();
    this.manualButton.onclick = () => this.manual();
    this.holdButton.onclick = () => this.hold();
    this.holdButton.hidden = !["surge", "sway", "yaw"].every((axis) => system.axes.includes(axis));
  }

  get state() {
    return this.store.fresh("helm/state", 1.5);
  }

  /** Whether this page's stick acts. */
  get driving() {
    const state = this.state;
    return this.link.open && Object.values(state?.sources ?? {}).includes("manual") && state.holder === this.link.client;
  }

  stop() {
    this.later = null;
    const wish = this.request("stop");
    if (this.link.send(wish)) return;
    this.link.afterReconnect = wish;
    toast("No connection. Stop is sent as soon as there is one.", { level: "error" });
  }

  manual() {
    this.ask("manual");
  }

  /** Hold the chosen place; what is not named is where the vessel is now, as the helm knows best. */
  hold() {
    this.ask("hold", this.reference.chosen ?? {});
  }

  /** Ask at once; while the helm is silent as soon as it is there: it would not hear. */
  ask(mode, pose = {}, take = false) {
    this.later = this.link.open && !this.state ? { mode, pose, take, until: performance.now() + THERE_MS } : null;
    if (this.later) toast(`The helm is silent: ${mode} waits for it, STOP takes it back`);
    else if (!this.link.send(this.request(mode, pose, take))) toast("No connection to the server.", { level: "error" });
  }

  askLater() {
    const { mode, pose, take, until } = this.later;
    if (this.state) this.ask(mode, pose, take);
    else if (performance.now() > until) {
      this.later = null;
      toast(`The helm is silent: ${mode} was not asked for`, { level: "error" });
    }
  }

  request(mode, pose = {}, take = false) {
    const request_id = `${this.link.client}-${++this.requests}`;
    this.waiting.set(request_id, { mode, pose });
    setTimeout(() => this.waiting.delete(request_id) && toast("The helm does not answer.", { level: "error" }), ANSWER_MS);
    return { type: "mode", request_id, mode, ...pose, take };
  }

  answered({ request_id, accepted, reason }) {
    const wish = this.waiting.get(request_id);
    if (!this.waiting.delete(request_id)) return;
    if (accepted) {
      if (["hold", "heading", "speed"].includes(wish.mode)) this.reference.clear();
      if (wish.pose.points) this.route.clear();
      toast(ACCEPTED[wish.mode] ?? "Holding");
      return;
    }
    const take = { label: "Take over", run: () => this.ask(wish.mode, wish.pose, true) };
    toast(`${wish.mode} refused: ${reason}`, { level: "error", action: this.heldByOther() ? take : null });
  }

  heldByOther() {
    const state = this.state;
    const expires = (state?.lease_expires_ns ?? 0) / 1e9;
    return Boolean(state?.attended && state.holder && state.holder !== this.link.client && expires > this.store.nowS());
  }

  /** Called with every frame of the server, which a hidden tab still gets in time. */
  renew() {
    const now = performance.now();
    if (now - this.renewedAt < RENEW_MS || this.state?.holder !== this.link.client) return;
    this.renewedAt = now;
    this.link.send({ type: "renew" });
  }

  show() {
    if (this.later) this.askLater();
    const state = this.state;
    const mode = state?.mode ?? "";
    this.modeOutput.dataset.mode = mode;
    this.modeOutput.dataset.status = !state ? "unknown" : state.suspended ? "suspended" : state.status;
    text(this.modeOutput, mode ? (state.suspended ? `${mode} · suspended` : (NAMES[mode] ?? mode)) : "unknown");
    this.modeOutput.value = this.modeOutput.textContent;
    this.manualButton.setAttribute("aria-pressed", mode === "manual");
    this.holdButton.setAttribute("aria-pressed", mode === "hold");
    this.wall.show(mode);
    text(this.holdButton, this.reference.chosen ? "Hold there" : "Hold here");
    text(this.leaseNote, this.lease(state));
    text(this.guardNote, state?.guard ? `Guard: kept ${state.guard}` : "");
    this.guardNote.hidden = !state?.guard;
    this.leaseNote.hidden = Boolean(state?.guard) && this.leaseNote.textContent === MINE; // the stick below stays under the hand
    this.reference.follow();
  }

  lease(state) {
    if (!state) return "The helm is silent.";
    const reason = state.reason ? ` · ${state.reason}` : "";
    const use = this.holdButton.hidden ? "Heading and Speed take its heading." : "Press Hold to go there; Heading and Speed take its heading.";
    if (this.reference.chosen) return `Chosen: ${this.reference.describe()}. ${use}`;
    if (state.holder === this.link.client) return MINE + reason;
    return (state.holder ? `${state.holder} has the helm` : "Nobody has the helm") + reason;
  }
}
