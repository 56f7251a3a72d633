// Short notices; an error stays longer, one with an action until it is used or dismissed.

import { h } from "./format.js";

const box = document.querySelector("#toasts");

export function toast(message, { level = "info", action = null, seconds = level === "error" ? 8 : 3 } = {}) {
  const element = h("div", { class: "toast", "data-level": level }, h("span", {}, message));
  if (action) element.append(h("button", { type: "button", onclick: () => (element.remove(), action.run()) }, action.label));
  element.append(h("button", { type: "button", class: "plain", "aria-label": "Dismiss", onclick: () => element.remove() }, "×"));
  box.append(element);
  while (box.children.length > 3) box.firstChild.remove();
  setTimeout(() => element.remove(), (action ? 15 : seconds) * 1000);
}
