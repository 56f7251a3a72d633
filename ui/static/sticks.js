// Stick positions from pointer, keyboard and gamepad: all spring back, all are let go when the page loses the focus.

const DEAD_ZONE = 0.08;
const KEYS = {
  KeyW: [1, 0, 0], ArrowUp: [1, 0, 0], KeyS: [-1, 0, 0], ArrowDown: [-1, 0, 0],
  KeyD: [0, 1, 0], ArrowRight: [0, 1, 0], KeyA: [0, -1, 0], ArrowLeft: [0, -1, 0],
  KeyE: [0, 0, 1], KeyQ: [0, 0, -1],
};

const clamp = (value) => Math.max(-1, Math.min(1, value));

/** Nothing within the dead zone, then from zero up to one without a jump. */
function beyondDeadZone(value) {
  const size = Math.abs(value);
  return size <= DEAD_ZONE ? 0 : (Math.sign(value) * (size - DEAD_ZONE)) / (1 - DEAD_ZONE);
}

export const isTyping = (event) => event.target.matches?.("input, textarea, select");

/** One on-screen stick: x and y in [-1, 1], y downwards; zero when let go. */
class Stick {
  constructor(element, horizontalOnly = false) {
    this.element = element;
    this.knob = element.querySelector(".knob");
    this.horizontalOnly = horizontalOnly;
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
    const reach = (this.horizontalOnly ? box.width : Math.min(box.width, box.height)) / 2 - this.knob.offsetWidth / 2;
    let x = (event.clientX - box.left - box.width / 2) / reach;
    let y = this.horizontalOnly ? 0 : (event.clientY - box.top - box.height / 2) / reach;
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
  constructor() {
    this.stick = new Stick(document.querySelector("#stick"));
    this.yaw = new Stick(document.querySelector("#yaw-stick"), true);
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
  }

  /** {surge, sway, yaw} in [-1, 1] from everything that is deflected now. */
  read() {
    const pad = this.readGamepad();
    let surge = beyondDeadZone(-this.stick.y) + pad.surge;
    let sway = beyondDeadZone(this.stick.x) + pad.sway;
    let yaw = beyondDeadZone(this.yaw.x) + pad.yaw;
    const size = this.gentle ? 0.35 : 1;
    for (const code of this.pressed) {
      const [ds, dw, dy] = KEYS[code];
      [surge, sway, yaw] = [surge + ds * size, sway + dw * size, yaw + dy * size];
    }
    return { surge: clamp(surge), sway: clamp(sway), yaw: clamp(yaw) };
  }

  readGamepad() {
    const pad = document.hasFocus() ? [...(navigator.getGamepads?.() ?? [])].find((p) => p?.connected) : undefined;
    this.gamepadName = pad ? pad.id.split("(")[0].trim() : "";
    if (!pad) return { surge: 0, sway: 0, yaw: 0, stop: false };
    const axis = (index) => beyondDeadZone(pad.axes[index] ?? 0);
    return { surge: -axis(1), sway: axis(0), yaw: axis(2), stop: pad.buttons[1]?.pressed ?? false };
  }

  show({ surge, sway, yaw }) {
    this.stick.show(sway, -surge);
    this.yaw.show(yaw, 0);
    for (const [axis, value] of Object.entries({ surge, sway, yaw })) {
      const cell = document.querySelector(`#stick-values [data-axis=${axis}]`);
      const shown = `${Math.round(value * 100)} %`.replace("-", "−");
      if (cell.textContent !== shown) cell.textContent = shown;
    }
  }
}
