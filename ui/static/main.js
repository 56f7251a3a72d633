// Puts the page together: what comes in goes to the store; what is drawn is drawn from the store.

import { Calibration } from "./calibration.js";
import { CameraView } from "./camera.js";
import { Experiment } from "./experiment.js";
import { Faults } from "./faults.js";
import { DEG, fixed, text } from "./format.js";
import { Health } from "./health.js";
import { Helm } from "./helm.js";
import { Link } from "./link.js";
import { PoolMap } from "./map.js";
import { Modes } from "./modes.js";
import { Plots } from "./plots.js";
import { Reference } from "./reference.js";
import { Route } from "./route.js";
import { isTyping, Sticks } from "./sticks.js";
import { Store } from "./store.js";
import { Table } from "./table.js";
import { toast } from "./toasts.js";
import { Tune } from "./tune.js";

const STICK_MS = 50;

const fetchJson = async (path) => (await fetch(path)).json();
const [system, topics] = await Promise.all([fetchJson("/api/system"), fetchJson("/api/topics")]);
document.title = `${system.vessel} · Starboard`;
text(document.querySelector("#vessel"), system.title);

/** {unit, doc} of a field, or of a key when the path is empty. */
function describe(key, path) {
  const topic = topics.find((t) => t.key === key || new RegExp(`^${t.key.replace(/\{\w+\}/g, "[^/]+")}$`).test(key));
  if (!path) return { unit: "", doc: topic?.doc ?? "not declared in bus/topics.py" };
  return topic?.fields[path.split(".")[0]] ?? { unit: "", doc: "" };
}
const units = new Map();
function unitOf(key, path) {
  const name = `${key} ${path}`;
  return units.get(name) ?? units.set(name, describe(key, path).unit).get(name);
}

const store = new Store();
const link = new Link({ onFrame, onImage });
const reference = new Reference(system, acting);
const route = new Route(system);
const helm = new Helm(link, store, reference, route, system);
const map = new PoolMap(store, system, reference, route);
const camera = new CameraView(store, system);
const modes = new Modes(helm, reference, system);
const sticks = new Sticks(system.axes.includes("heave"));
const plots = new Plots(store, system, unitOf);
const table = new Table(store, plots, describe);
const health = new Health(store, link, system);
const experiment = new Experiment(helm, store, system);
const tune = new Tune(helm, link, store, system);
const faults = new Faults(link, store, system);
const calibration = new Calibration(link, store);

/** The reference in force, or where the vessel is: what a new choice starts from. */
function acting() {
  const state = helm.state;
  const pose = store.get("navigation/state");
  if (state?.mode === "hold" && state.x_m != null) return state;
  return pose && { x_m: pose.x_m, y_m: pose.y_m, psi_rad: state?.psi_rad ?? pose.psi_rad };
}

let aliveAt = 0;
function onFrame(frame) {
  store.apply(frame);
  for (const answer of frame.answers) {
    helm.answered(answer);
    tune.answered(answer);
  }
  if (frame.refused) toast(`The server refused a message: ${frame.refused}`, { level: "error" });
  helm.renew();
  camera.showExamined();
  requestAnimationFrame(draw);
  if (performance.now() - aliveAt > 500) {
    aliveAt = performance.now();
    link.send({ type: "alive" });
  }
}

function onImage(key, header, jpeg) {
  if (key === "camera/image" && !document.hidden) camera.show(header, jpeg);
}

// --- joystick: repeated while this page has the stick, centred too, so that the helm knows we are there

const CENTRE = { surge: 0, sway: 0, yaw: 0 };
let sent = CENTRE;
setInterval(() => {
  if (sticks.readGamepad().stop && helm.state?.mode !== "stop") helm.stop();
  const wanted = sticks.read();
  const { driving } = helm;
  sticks.show(wanted);
  if (driving || Object.values(sent).some(Boolean)) {
    sent = driving ? wanted : CENTRE;
    link.send({ type: "joystick", ...sent });
  }
  sticks.driving = driving;
  document.querySelector("#sticks-panel").dataset.active = driving;
  const moved = Object.values(wanted).some(Boolean);
  text(document.querySelector("#stick-note"), driving ? `sending${sticks.gamepadName ? ` · ${sticks.gamepadName}` : ""}` : moved ? "not sent: press Manual first" : "acts in Manual");
}, STICK_MS);

addEventListener("keydown", (event) => {
  if (event.repeat || event.ctrlKey || event.altKey || event.metaKey) return;
  if (event.key === "Escape" || (event.code === "Space" && !isTyping(event))) helm.stop();
  else if (isTyping(event)) return;
  else if (event.code === "KeyM") helm.manual();
  else if (event.code === "KeyH") helm.hold();
  else return;
  event.preventDefault(); // Space must not press the button that has the focus as well
});
addEventListener("keyup", (event) => event.code === "Space" && !isTyping(event) && event.preventDefault());

// --- tabs

function openTab(id) {
  for (const tab of document.querySelectorAll("[role=tab]")) {
    tab.setAttribute("aria-selected", tab.dataset.tab === id);
    document.getElementById(tab.dataset.tab).hidden = tab.dataset.tab !== id;
  }
}
for (const tab of document.querySelectorAll("[role=tab]")) tab.onclick = () => openTab(tab.dataset.tab);
document.querySelector("#lamp-services").onclick = () => {
  openTab("health");
  document.querySelector("#tabs-panel").scrollIntoView({ block: "nearest", behavior: "smooth" });
};

// --- drawing

function showReadout() {
  const state = store.fresh("navigation/state", 1);
  const shown = { x: fixed(state?.x_m, 3), y: fixed(state?.y_m, 3), psi: fixed(state?.psi_rad * DEG, 1),
    u: fixed(state?.surge_m_s, 3), v: fixed(state?.sway_m_s, 3), r: fixed(state?.yaw_rad_s * DEG, 1), z: fixed(state?.z_m, 2), w: fixed(state?.heave_m_s, 3) };
  for (const [field, value] of Object.entries(shown)) text(document.querySelector(`#readout [data-field=${field}]`), value);
  document.querySelector("#readout").dataset.status = state?.status ?? "lost";
  document.querySelector("#legend-truth").hidden = !store.get("simulation/truth");
}

let drawn = -1;
function draw() {
  if (store.version === drawn) return;
  drawn = store.version;
  map.draw();
  showReadout();
  helm.show();
  plots.tick();
}

setInterval(() => {
  health.showBanner();
  health.tick();
  table.tick();
  faults.tick();
  experiment.tick();
  tune.tick();
  calibration.tick();
  camera.tick();
  helm.show();
  modes.show();
}, 250);

// --- for tests and for the curious at the console

window.starboard = {
  /** Where a place in the pool is on the screen, in client pixels. */
  worldToMap: (x_m, y_m) => map.worldToClient(x_m, y_m),
  /** Break the connection, as a bad network does. */
  cut: () => link.socket.close(),
  /** What the page knows now. */
  get state() {
    return {
      client: link.client,
      connected: link.open,
      driving: helm.driving,
      chosen: reference.chosen,
      route: route.points,
      sent,
      values: Object.fromEntries([...store.variables].map(([key, variable]) => [key, variable.value])),
    };
  },
};
