// How the services and the devices fare: lamps in the head, the Services tab, and what the banner must shout.

import { age, breakable, bytes, fixed, h, rate, text } from "./format.js";
import { toast } from "./toasts.js";

const DEAD_S = 2.5;
const HAPPENED_MS = 15000;
const REFUSED_MS = 3000;
const ENDED = /^the measured pose jumped |: dropped a malformed message: /; // notes of what happened; others tell of what lasts
const WELL = /^engaged models: /;
const beat = (name) => `service/${name}/heartbeat`;

export class Health {
  constructor(store, link, system) {
    Object.assign(this, { store, link, system });
    this.element = document.querySelector("#health");
    this.devices = h("div", { class: "devices" });
    this.table = h("table", {}, h("thead", {}, h("tr", {}, ...["Service", "State", "Rate", "Step, ms", "Late", "Bad", "Gaps"].map((name) => h("th", {}, name)))));
    this.actuators = h("table", { id: "actuators" }, h("thead", {}, h("tr", {}, ...["Actuator", "State", "Command", ""].map((name) => h("th", {}, name)))),
      ...system.actuators.map((name) => this.actuatorRow(name)));
    this.element.append(this.actuators, this.table, this.devices);
    this.rows = new Map();
    this.notes = new Map(); // service -> {told, at}: its note, and since when
    this.measured = { jumps: NaN, rejected: NaN, jumpedAt: -Infinity, rejectedAt: -Infinity };
  }

  /** When the measured pose last jumped for good, and when one was last refused: the counts of navigation/state. */
  watchPose() {
    const state = this.store.get("navigation/state");
    if (!state) return;
    for (const [count, at] of [["jumps", "jumpedAt"], ["rejected", "rejectedAt"]]) {
      if (state[count] > this.measured[count]) this.measured[at] = performance.now();
      this.measured[count] = state[count];
    }
  }

  names() {
    const seen = [...this.store.variables.keys()].filter((key) => /^service\/[^/]+\/heartbeat$/.test(key)).map((key) => key.split("/")[1]);
    return [...new Set([...this.system.services, ...seen])].sort();
  }

  /** {state, level, why} of a service by its heartbeat. */
  judge(name) {
    const heartbeat = this.store.get(beat(name));
    if (!heartbeat) return { state: "not seen", level: "off" };
    const silentS = (performance.now() - this.store.variables.get(beat(name)).receivedAt) / 1000;
    if (heartbeat.state === "stopping") return { state: "stopped", level: "off" };
    if (silentS > DEAD_S) return { state: `silent ${age(silentS)}`, level: "error" };
    if (heartbeat.state === "running" && !this.warns(name, heartbeat)) return { state: "running", level: "ok" };
    return { state: heartbeat.state, level: "warn", why: heartbeat.note };
  }

  /** Whether a service's note is a reason to look: one of something that is over only while it is new. */
  warns(name, { note, malformed }) {
    const told = `${note} ${malformed}`;
    if (this.notes.get(name)?.told !== told) this.notes.set(name, { told, at: performance.now() });
    const over = WELL.test(note) || (ENDED.test(note) && performance.now() - this.notes.get(name).at > HAPPENED_MS);
    return note !== "" && !over;
  }

  tick() {
    this.watchPose();
    this.showLamps();
    if (!this.element.checkVisibility()) return;
    for (const name of this.names()) this.showService(name, this.rows.get(name) ?? this.addRow(name));
    this.showActuators();
    this.showDevices();
  }

  actuatorRow(name) {
    const button = (label, works) => h("button", { type: "button", onclick: () => this.say(name, works) }, label);
    return h("tbody", { "data-actuator": name }, h("tr", {}, h("th", { scope: "row" }, ...breakable(name)), h("td", { class: "num" }), h("td", { class: "num" }),
      h("td", { class: "actions" }, button("Leave it out", false), button("Works again", true))));
  }

  /** The operator's word about an actuator: the allocator follows it. */
  say(name, works) {
    if (this.link.send({ type: "actuator", actuator: name, works })) toast(works ? `${name} shall work again` : `${name} is left out`);
    else toast("No connection to the server.", { level: "error" });
  }

  showActuators() {
    const { failed = {}, lost = {} } = this.store.get("actuator/health") ?? {};
    const { suspected } = this.store.fresh("actuator/fault", DEAD_S) ?? {};
    const commands = this.store.fresh("actuator/command", 1)?.commands ?? {};
    for (const body of this.actuators.tBodies) {
      const name = body.dataset.actuator;
      const [, state, command, action] = body.rows[0].cells;
      const bad = failed[name] ?? (lost[name] ? "detected" : undefined);
      body.dataset.level = bad ? "error" : suspected === name ? "warn" : "ok";
      const how = lost[name] ? `, ${fixed(lost[name] * 100, 0)} % lost` : "";
      text(state, failed[name] ? `failed (${failed[name]}${how})` : bad ? `weak (detected${how})` : suspected === name ? "suspected" : "works");
      text(command, fixed(commands[name], 1));
      const [leaveOut, worksAgain] = action.children;
      leaveOut.hidden = name in failed;
      worksAgain.hidden = !bad;
    }
  }

  addRow(name) {
    const cells = Array.from({ length: 6 }, () => h("td", { class: "num" }));
    const note = h("td", { colspan: "7" });
    const row = { cells, note, body: h("tbody", { "data-service": name }, h("tr", {}, h("th", { scope: "row" }, ...breakable(name)), ...cells), h("tr", { class: "note", hidden: true }, note)) };
    const next = [...this.table.tBodies].find((body) => body.dataset.service > name);
    this.table.insertBefore(row.body, next ?? null);
    this.rows.set(name, row);
    return row;
  }

  showService(name, { body, cells, note }) {
    const { state, level } = this.judge(name);
    const b = this.store.get(beat(name)) ?? {};
    body.dataset.level = level;
    const step = b.pid === undefined ? "" : `${fixed(b.step_mean_ms, 1)} / ${fixed(b.step_max_ms, 1)}`;
    const shown = [state, rate(b.rate_hz), step, b.late_steps, b.malformed, b.gaps];
    shown.forEach((value, i) => text(cells[i], String(value ?? "")));
    for (const i of [3, 4, 5]) cells[i].classList.toggle("warn", shown[i] > 0);
    text(note, b.note ?? "");
    note.parentElement.hidden = !b.note;
  }

  showDevices() {
    const link = this.store.get("link/status");
    const camera = this.store.get("camera/status");
    const recorder = this.store.get("recorder/status");
    const battery = this.store.get("link/telemetry")?.battery_v;
    const { server } = this.store;
    const cards = [
      ["Radio link", link && `${link.state} · ${link.port}`, link && (link.error || `lost ${link.lost} of ${link.received + link.lost} · bad CRC ${link.crc_errors + link.platform_crc_errors} · round trip ${age(link.round_trip_s ?? NaN)}${battery ? ` · ${fixed(battery, 1)} V` : ""}`)],
      ["Camera", camera && `${camera.state} · ${camera.camera}`, camera && (camera.error || `${rate(camera.rate_hz)} · dropped ${camera.frames_dropped} · ${fixed(camera.latency_s * 1000, 1)} ms`)],
      ["Recorder", recorder && `${recorder.state} · ${recorder.file.split("/").at(-1)}`, recorder && (recorder.error || `${bytes(recorder.size_bytes)} · ${recorder.messages} messages · dropped ${recorder.dropped}`)],
      ["Clocks", ...this.clocks()],
      ["Page", `${this.link.client} · ${server.pages} open`, `refused from pages ${server.refused} · malformed on the bus ${server.malformed} · dropped ${server.dropped}`],
    ];
    cards.forEach(([title, first, second], i) => {
      const card = this.devices.children[i] ?? this.devices.appendChild(h("div", {}, h("b", {}, title), h("span"), h("small")));
      text(card.children[1], first || "not seen");
      text(card.children[2], second || "");
    });
  }

  /** To what stamps of two services can be compared (their clocks' uncertainties), and whose clock is not the hub's. */
  clocks() {
    const beats = this.names().map((name) => [name, this.store.get(beat(name))]).filter(([, b]) => b?.clock_uncertainty_s != null);
    if (!beats.length) return ["", ""];
    const worst = beats.map(([, b]) => b.clock_uncertainty_s).sort((a, b) => b - a);
    const off = beats.filter(([, b]) => b.clock_offset_s).map(([name, b]) => `${name} ${fixed(b.clock_offset_s * 1000, 1)} ± ${fixed(b.clock_uncertainty_s * 1000, 1)} ms`);
    return [`stamps comparable to ${fixed((worst[0] + (worst[1] ?? 0)) * 1000, 1)} ms`, off.length ? `corrected: ${off.join(", ")}` : "none differs from the hub's"];
  }

  showLamps() {
    const lamp = (id, level, label) => {
      const element = document.getElementById(id);
      element.dataset.level = level;
      text(element, label);
    };
    const link = this.store.fresh("link/status", DEAD_S);
    lamp("lamp-link", !link ? "off" : link.state === "connected" ? "ok" : "error", link?.state === "connected" ? `Link ${age(link.round_trip_s ?? NaN)}` : "Link down");
    const camera = this.store.fresh("camera/status", DEAD_S);
    const refused = camera?.state === "tracking" && performance.now() - this.measured.rejectedAt < REFUSED_MS;
    const seen = refused ? "pose refused" : camera?.state;
    lamp("lamp-camera", !camera ? "off" : refused ? "warn" : { tracking: "ok", searching: "warn", no_camera: "error" }[camera.state], !camera ? "Camera silent" : camera.state === "no_camera" ? "No camera" : `Camera ${seen}`);
    const recorder = this.store.fresh("recorder/status", DEAD_S);
    lamp("recording", !recorder ? "off" : { recording: "rec", idle: "warn", error: "error" }[recorder.state], recorder?.state === "recording" ? `REC ${bytes(recorder.size_bytes)}` : recorder ? `Recorder ${recorder.state}` : "Not recording");
    const judged = this.names().map((name) => [name, this.judge(name)]);
    const levels = judged.map(([, { level }]) => level);
    const good = levels.filter((level) => level === "ok" || level === "warn").length;
    lamp("lamp-services", levels.includes("error") ? "error" : good < levels.length || levels.includes("warn") ? "warn" : "ok", `Services ${good}/${levels.length}`);
    const why = judged.filter(([, { level }]) => level !== "ok").map(([name, { state, why }]) => `${name}: ${why || state}`);
    document.getElementById("lamp-services").title = ["Show the services", ...why].join("\n");
  }

  /** Everything that must be shouted now, worst first: [level, title, detail, what to do about it]. */
  alarms() {
    const now = performance.now();
    if (!this.link.connectedOnce && now < 1500) return [];
    if (now - this.link.frameAt > 1000)
      return [["error", "Connection to the server lost", " What you see is old. Trying again …"]];
    const silentS = (now - this.store.newAt) / 1000;
    if (silentS > 1) return [["error", "Nothing comes from the bus", ` for ${age(silentS)}. Is the hub running?`]];
    const alarms = [];
    const helm = this.store.fresh("helm/state", 1.5);
    const state = this.store.fresh("navigation/state", 1);
    const link = this.store.fresh("link/status", DEAD_S);
    if (!helm) alarms.push(["error", "The helm is silent", " The mode shown is not certain."]);
    else if (helm.status === "fault") alarms.push(["error", "Fault", ` ${helm.reason}. It has stopped: choose a mode to go on.`]);
    else if (helm.suspended) alarms.push(["error", "Suspended", ` ${helm.reason || "the thrusters are at zero"}`]);
    const camera = this.store.fresh("camera/status", DEAD_S);
    if (camera?.state === "no_camera" && state?.status !== "tracking") alarms.push(["warn", "No camera", ` ${camera.error}`]);
    else if (!state) alarms.push(["warn", "No position", camera?.state === "searching" ? " The camera does not see the vessel." : " The estimator is silent."]);
    else if (state.status === "lost") alarms.push(["warn", "Position lost", " The camera does not see the vessel."]);
    if (now - this.measured.jumpedAt < HAPPENED_MS) {
      const told = /^the measured pose jumped (.*)$/.exec(this.store.get(beat("estimator"))?.note ?? "")?.[1];
      alarms.push(["warn", "The measured pose jumped", ` ${told ?? ""}. The vessel goes back slowly.`]);
    }
    const health = this.store.fresh("actuator/health", DEAD_S);
    const detected = Object.keys(health?.lost ?? {}).find((name) => !(name in health.failed));
    const [leftOut] = Object.entries(health?.failed ?? {}).find(([, why]) => why === "detected") ?? [];
    const remedy = detected
      ? { label: `Leave ${detected} out`, run: () => this.say(detected, false) }
      : leftOut && { label: `${leftOut} works again`, run: () => this.say(leftOut, true) };
    if (health?.reason) alarms.push(["warn", "Actuator", ` ${health.reason}`, remedy]);
    if (link?.state === "disconnected") alarms.push(["warn", "Radio link down", ` ${link.error}`]);
    return alarms;
  }

  showBanner() {
    const alarms = this.alarms();
    const banner = document.querySelector("#banner");
    banner.hidden = !alarms.length;
    if (!alarms.length) return;
    const [level, title, detail] = alarms[0];
    banner.dataset.level = level;
    text(banner.children[0], title);
    text(banner.children[1], detail + alarms.slice(1).map((alarm) => ` · ${alarm[1]}`).join(""));
    const action = alarms.find((alarm) => alarm[3])?.[3];
    const button = banner.children[2];
    button.hidden = !action;
    text(button, action?.label ?? "");
    button.onclick = action?.run;
  }
}
