// Every field of every key: value, unit, age, rate. A click on a number plots it.

import { age, breakable, h, number, rate, text } from "./format.js";
import { leaves } from "./store.js";

export class Table {
  constructor(store, plots, describe) {
    Object.assign(this, { store, plots, describe });
    this.element = document.querySelector("#vars");
    this.groups = new Map(); // key -> {body, age, rate, rows: Map(path -> row)}
    this.filter = document.querySelector("#vars-filter");
    this.filter.oninput = () => this.applyFilter();
    plots.onChange = () => this.showPlotted();
  }

  tick() {
    if (!this.element.checkVisibility()) return;
    for (const [key, variable] of this.store.variables) {
      const group = this.groups.get(key) ?? this.add(key);
      const seconds = this.store.ageS(key);
      text(group.age, age(seconds));
      group.body.dataset.age = seconds > Math.max(1, 4 / (variable.rate || 4)) ? "old" : "new";
      text(group.rate, rate(this.store.rate(key)));
      for (const [path, value] of leaves(variable.value)) {
        const row = group.rows.get(path) ?? this.addRow(key, group, path);
        text(row.value, shown(value));
        if (typeof value === "string") row.value.title = value; // it may be longer than the column
        if (typeof value === "number" && row.button.disabled) row.button.disabled = false;
      }
    }
  }

  add(key) {
    const { doc } = this.describe(key, "");
    const group = { body: h("tbody", { "data-key": key }), age: h("td", { class: "num" }), rate: h("td", { class: "num" }), rows: new Map() };
    group.body.append(h("tr", { class: "group", title: doc }, h("th", { scope: "rowgroup" }, ...breakable(key)), group.age, group.rate));
    const next = [...this.element.tBodies].find((body) => body.dataset.key > key);
    this.element.insertBefore(group.body, next ?? null);
    this.groups.set(key, group);
    return group;
  }

  addRow(key, group, path) {
    const { unit, doc } = this.describe(key, path);
    const button = h("button", { type: "button", disabled: true, title: doc || `plot ${key} ${path}`, onclick: () => this.plots.toggle(key, path) }, ...breakable(path));
    const value = h("td", { class: "num" });
    const element = h("tr", { "data-path": path }, h("td", {}, button), value, h("td", { class: "unit" }, unit));
    group.body.append(element);
    const row = { element, button, value, search: `${key} ${path} ${unit}`.toLowerCase() };
    group.rows.set(path, row);
    button.setAttribute("aria-pressed", this.plots.has(key, path));
    this.filterRow(group, row);
    return row;
  }

  showPlotted() {
    for (const [key, group] of this.groups)
      for (const [path, row] of group.rows) row.button.setAttribute("aria-pressed", this.plots.has(key, path));
  }

  applyFilter() {
    for (const group of this.groups.values()) {
      group.body.hidden = true;
      for (const row of group.rows.values()) this.filterRow(group, row);
    }
  }

  filterRow(group, row) {
    const words = this.filter.value.toLowerCase().split(/\s+/).filter(Boolean);
    const fits = words.every((word) => row.search.includes(word));
    row.element.hidden = !fits;
    if (fits) group.body.hidden = false;
    else if (group.rows.size === 1) group.body.hidden = true;
  }
}

function shown(value) {
  if (typeof value === "number") return number(value);
  if (value === null || value === "") return "–";
  return String(value);
}
