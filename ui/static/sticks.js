// Stick positions from pointer, keyboard and gamepad: all spring back, all are let go when the page loses the focus.

const DEAD_ZONE = 0.08;
const KEYS = {
  KeyW: { surge: 1 }, ArrowUp: { surge: 1 }, KeyS: { surge: -1 }, ArrowDown: { surge: -1 },
  KeyD: { sway: 1 }, ArrowRight: { sway: 1 }, KeyA: { sway: -1 }, ArrowLeft: { sway: -1 },
  KeyE: { yaw: 1 }, KeyQ: { yaw: -1 }, KeyF: { heave: 1 }, KeyR: { heave: -1 },
};

const clamp = (value) => Math.max(-1, Math.min(1, value));

/** Nothing within the dead zone, then from zero up to one without a jump. */
function beyondDeadZone(value) {
  const size = Math.abs(value);
  return size <= DEAD_ZONE ? 0 : (Math.sign(value) * (size - DEAD_ZONE)) / (1 - DEAD_ZONE);
}

export const isTyping = (event) => event.target.matches?.("input, textarea, select");

/** One on-screen stick: x and y in [-1, 1], y downwards; zero when let go. `only` "x" or "y": a slider. */
class Stick {
  constructor(element, only = "") {
    this.element = element;
    this.knob = element.querySelector(".knob");
    this.only = only;
    this.x = this.y = 0;
    this.pointer = null;
    element.addEventListener("pointerdown", (event) => {
      if (this.pointer !== null || event.button > 0) return;
      this.pointer = event.pointerId;
      element.setPointerCapture(event.pointerId);
      element.classList.add("held");
      this.move(event);
      event.preventDefault();
      document.activeElement?.blur(); // the keys drive now, they do not type
    });
    element.addEventListener("pointermove", (event) => event.pointerId === this.pointer && this.move(event));
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"])
      element.addEventListener(end, (event) => event.pointerId === this.pointer && this.release());
  }

  move(event) {
    const box = this.element.getBoundingClientRect();
    const reach = (this.only ? Math.max(box.width, box.height) : Math.min(box.width, box.height)) / 2 - this.knob.offsetWidth / 2;
    const x = this.only === "y" ? 0 : (event.clientX - box.left - box.width / 2) / reach;
    const y = this.only === "x" ? 0 : (event.clientY - box.top - box.height / 2) / reach;
    const length = Math.max(1, Math.hypot(x, y));
    [this.x, this.y] = [x / length, y / length];
  }

  release() {
    this.pointer = null;
    this.x = this.y = 0;
    this.element.classList.remove("held");
  }

  /** Draw the knob where the command is, whatever moved it. */
  show(x, y) {
    const reachX = (this.element.clientWidth - this.knob.offsetWidth) / 2;
    const reachY = (this.element.clientHeight - this.knob.offsetHeight) / 2;
    this.knob.style.transform = `translate(${x * reachX}px, ${y * reachY}px)`;
  }
}

export class Sticks {
  /** dives: there is a stick for heave, too (positive: down, as z). */
  constructor(dives = false) {
    this.stick = new Stick(document.querySelector("#stick"));
    this.yaw = new Stick(document.querySelector("#yaw-stick"), "x");
    this.heave = new Stick(document.querySelector("#heave-stick"), "y");
    this.dives = dives;
    for (const element of document.querySelectorAll("#heave-stick, [data-heave]")) element.hidden = !dives;
    this.pressed = new Set();
    this.gentle = false;
    this.driving = false; // whether the stick acts: only then are the arrow keys taken from scrolling
    this.gamepadName = "";
    addEventListener("keydown", (event) => {
      if (!(event.code in KEYS) || isTyping(event) || event.ctrlKey || event.altKey || event.metaKey) return;
      this.pressed.add(event.code);
      this.gentle = event.shiftKey;
      if (this.driving) event.preventDefault();
    });
    addEventListener("keyup", (event) => {
      this.pressed.delete(event.code);
      this.gentle = event.shiftKey;
    });
    for (const lost of ["blur", "pagehide"]) addEventListener(lost, () => this.release());
    document.addEventListener("visibilitychange", () => document.hidden && this.release());
  }

  release() {
    this.pressed.clear();
    this.stick.release();
    this.yaw.release();
    this.heave.release();
  }

  /** {surge, sway, yaw}, and heave of a vessel that dives, in [-1, 1] from everything that is deflected now. */
  read() {
    const pad = this.readGamepad();
    const command = { surge: beyondDeadZone(-this.stick.y) + pad.surge, sway: beyondDeadZone(this.stick.x) + pad.sway, yaw: beyondDeadZone(this.yaw.x) + pad.yaw };
    if (this.dives) command.heave = beyondDeadZone(this.heave.y) + pad.heave;
    const size = this.gentle ? 0.35 : 1;
    for (const code of this.pressed) for (const [axis, sign] of Object.entries(KEYS[code])) if (axis in command) command[axis] += sign * size;
    for (const axis of Object.keys(command)) command[axis] = clamp(command[axis]);
    return command;
  }

  readGamepad() {
    const pad = document.hasFocus() ? [...(navigator.getGamepads?.() ?? [])].find((p) => p?.connected) : undefined;
    this.gamepadName = pad ? pad.id.split("(")[0].trim() : "";
    if (!pad) return { surge: 0, sway: 0, heave: 0, yaw: 0, stop: false };
    const axis = (index) => beyondDeadZone(pad.axes[index] ?? 0);
    return { surge: -axis(1), sway: axis(0), heave: axis(3), yaw: axis(2), stop: pad.buttons[1]?.pressed ?? false };
  }

  show(command) {
    this.stick.show(command.sway, -command.surge);
    this.yaw.show(command.yaw, 0);
    if (this.dives) this.heave.show(0, command.heave);
    for (const [axis, value] of Object.entries(command)) {
      const cell = document.querySelector(`#stick-values [data-axis=${axis}]`);
      const shown = `${Math.round(value * 100)} %`.replace("-", "−");
      if (cell.textContent !== shown) cell.textContent = shown;
    }
  }
}
