// Numbers, ages and angles as people read them.

export const DEG = 180 / Math.PI;

export const wrapDeg = (deg) => deg - 360 * Math.ceil((deg - 180) / 360);

/** A number with as many digits as help, never jumping about in width more than it must. */
export function number(value) {
  if (Number.isInteger(value)) return String(value).replace("-", "−");
  const size = Math.abs(value);
  if (size !== 0 && size < 0.001) return value.toExponential(2).replaceAll("-", "−");
  return value.toFixed(size < 1 ? 4 : size < 100 ? 3 : 1).replace("-", "−");
}

export const fixed = (value, digits) =>
  Number.isFinite(value) ? value.toFixed(digits).replace(/^-0(\.0*)?$/, "0$1").replace("-", "−") : "–";

export function age(seconds) {
  if (!Number.isFinite(seconds)) return "–";
  if (seconds > 0 && seconds < 0.00995) return `${(seconds * 1000).toFixed(1)} ms`;
  if (seconds < 0.9995) return `${Math.max(0, Math.round(seconds * 1000))} ms`;
  if (seconds < 100) return `${seconds.toFixed(1)} s`;
  return seconds < 5400 ? `${Math.round(seconds / 60)} min` : `${Math.round(seconds / 3600)} h`;
}

export const rate = (hz) => (Number.isFinite(hz) ? `${hz < 10 ? hz.toFixed(1) : Math.round(hz)} Hz` : "");

export function bytes(count) {
  const units = ["B", "kB", "MB", "GB", "TB"];
  let power = 0;
  for (; count >= 1000 && power < units.length - 1; power++) count /= 1000;
  return `${count.toFixed(power && count < 100 ? 1 : 0)} ${units[power]}`;
}

/** Make an element: h("td", {class: "x"}, "text", child). */
export function h(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value !== false && value != null) element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children);
  return element;
}

/** A key or name as parts between which a line may break. */
export const breakable = (name) => name.split(/(?<=[/_.])/).flatMap((part) => [part, h("wbr")]);

/** Set a text only when it changed: a write costs layout. */
export function text(element, value) {
  if (element.textContent !== value) element.textContent = value;
}
