// Live plots of chosen variables. Drawn at most 8 times a second, and only while they are on the screen.

import uPlot from "./vendor/uPlot/uPlot.esm.js";
import { DEG, fixed, h, number, text } from "./format.js";

const COLOURS = ["#4fc3df", "#f2b84b", "#8ee6a4", "#ff8a65", "#a99bf5", "#f28bb0", "#d5dde3", "#c3d94e"];
const PERIOD_MS = 125;
const MAX_CHARTS = 8;
const SAVED = "starboard.plots";
const LEAST_SPAN = { "": 0.1, N: 0.02, Nm: 0.002, m: 0.02, "°": 1, "m/s": 0.02, "°/s": 1 };

export class Plots {
  /** `unitOf(key, path)` gives the unit on the bus; angles are drawn in degrees. */
  constructor(store, system, unitOf) {
    Object.assign(this, { store, system, unitOf });
    this.box = document.querySelector("#plots");
    this.windowS = 60;
    this.paused = false;
    this.drawnAt = 0;
    this.visible = true;
    this.charts = [];
    this.onChange = () => {};
    this.listen();
    this.load(this.saved() ?? this.defaults());
  }

  defaults() {
    const state = "navigation/state";
    return [
      [[state, "x_m"], [state, "y_m"]],
      [[state, "psi_rad"]],
      [["control/status", "error_x_m"], ["control/status", "error_y_m"]],
      this.system.actuators.map((name) => ["actuator/command", `commands.${name}`]),
    ];
  }

  listen() {
    const pause = document.querySelector("#plots-pause");
    pause.onclick = () => {
      this.paused = !this.paused;
      pause.setAttribute("aria-pressed", this.paused);
      text(pause, this.paused ? "Go on" : "Pause");
    };
    document.querySelector("#plots-window").onchange = (event) => (this.windowS = Number(event.target.value));
    document.querySelector("#plots-reset").onclick = () => {
      localStorage.removeItem(SAVED);
      this.load(this.defaults());
    };
    new IntersectionObserver(([entry]) => (this.visible = entry.isIntersecting)).observe(this.box);
  }

  saved() {
    try {
      const charts = JSON.parse(localStorage.getItem(SAVED));
      const isPair = (pair) => Array.isArray(pair) && pair.length === 2 && pair.every((part) => typeof part === "string");
      return Array.isArray(charts) && charts.every((chart) => Array.isArray(chart) && chart.every(isPair)) ? charts : null;
    } catch {
      return null;
    }
  }

  save() {
    localStorage.setItem(SAVED, JSON.stringify(this.charts.map((chart) => chart.pairs)));
    this.onChange();
  }

  load(charts) {
    for (const chart of this.charts) chart.remove();
    this.charts = charts.slice(0, MAX_CHARTS).map((pairs) => new Chart(this, pairs));
    this.onChange();
  }

  has(key, path) {
    return this.charts.some((chart) => chart.index(key, path) >= 0);
  }

  /** Plot a variable, beside others that were added by hand and have its unit; or take it away. */
  toggle(key, path) {
    const chart = this.charts.find((c) => c.index(key, path) >= 0);
    if (chart) return this.drop(chart, key, path);
    const partner = this.charts.find((c) => c.byHand && c.pairs.length < 6 && c.unit === drawnUnit(this.unitOf(key, path)));
    if (partner) partner.set([...partner.pairs, [key, path]]);
    else {
      if (this.charts.length >= MAX_CHARTS) this.charts.shift().remove();
      this.charts.push(new Chart(this, [[key, path]], true));
      this.box.lastElementChild.scrollIntoView({ block: "nearest" });
    }
    this.save();
  }

  drop(chart, key, path) {
    const pairs = chart.pairs.filter((pair) => pair[0] !== key || pair[1] !== path);
    if (pairs.length) chart.set(pairs);
    else {
      chart.remove();
      this.charts.splice(this.charts.indexOf(chart), 1);
    }
    this.save();
  }

  tick() {
    const now = performance.now();
    const period = this.windowS > 100 ? 2 * PERIOD_MS : PERIOD_MS;
    if (this.paused || !this.visible || now - this.drawnAt < period) return;
    this.drawnAt = now;
    const end = this.store.nowS();
    for (const chart of this.charts) chart.draw(end - this.windowS, end);
  }
}

const drawnUnit = (unit) => ({ rad: "°", "rad/s": "°/s" })[unit] ?? unit;

class Chart {
  constructor(plots, pairs, byHand = false) {
    Object.assign(this, { plots, byHand });
    this.head = h("div", { class: "chart-head" });
    this.body = h("div", { class: "chart-body" });
    this.element = h("figure", { class: "chart" }, this.head, this.body);
    plots.box.append(this.element);
    this.resized = new ResizeObserver(() => this.plot?.setSize(this.size()));
    this.resized.observe(this.body);
    this.set(pairs);
  }

  size() {
    return { width: Math.max(120, this.body.clientWidth), height: Math.max(50, this.body.clientHeight) };
  }

  index(key, path) {
    return this.pairs.findIndex((pair) => pair[0] === key && pair[1] === path);
  }

  set(pairs) {
    this.pairs = pairs;
    this.unit = drawnUnit(this.plots.unitOf(...pairs[0]));
    this.plot?.destroy();
    this.plot = new uPlot(this.options(), [[], ...pairs.map(() => [])], this.body);
    this.values = pairs.map(() => h("b"));
    this.head.replaceChildren(
      ...pairs.map(([key, path], i) =>
        h("button", { type: "button", class: `series c${i % COLOURS.length}`, title: `${key} ${path}: take it off the plot`,
          onclick: () => this.plots.drop(this, key, path) }, short(path), " ", this.values[i])),
      h("span", { class: "unit" }, this.unit),
    );
  }

  options() {
    const axis = { stroke: "#7f97a5", grid: { stroke: "rgba(140,190,210,0.10)", width: 1 }, ticks: { show: false }, font: "11px system-ui, sans-serif" };
    const span = LEAST_SPAN[this.unit] ?? 1e-6;
    return {
      ...this.size(),
      padding: [8, 24, 0, 0],
      legend: { show: false },
      cursor: { sync: { key: "starboard" }, drag: { x: false, y: false }, points: { show: false } },
      scales: { x: { time: true }, y: { range: (_, low, high) => padded(low, high, span) } },
      axes: [{ ...axis, size: 24, space: 80, values: (_, times) => times.map(clock) }, { ...axis, size: 46, space: 22 }],
      series: [{}, ...this.pairs.map((_, i) => ({ stroke: COLOURS[i % COLOURS.length], width: 1.5, points: { show: false } }))],
    };
  }

  draw(from, to) {
    const blocks = new Map(); // key -> [times, values, ...] and where each series of it goes
    this.pairs.forEach(([key, path], i) => {
      const block = blocks.get(key) ?? blocks.set(key, { data: [this.times(key, from)], order: [] }).get(key);
      block.data.push(this.series(key, path, block.data[0].length, this.values[i]));
      block.order.push(i);
    });
    let data = [...blocks.values()][0].data;
    if (blocks.size > 1) {
      const joined = uPlot.join([...blocks.values()].map((block) => block.data));
      data = [joined[0]];
      [...blocks.values()].flatMap((block) => block.order).forEach((series, i) => (data[series + 1] = joined[i + 1]));
    }
    this.plot.batch(() => {
      this.plot.setData(data, false);
      this.plot.setScale("x", { min: from, max: to });
    });
  }

  times(key, from) {
    const times = this.plots.store.variables.get(key)?.times ?? [];
    let low = 0;
    for (let high = times.length; low < high; ) {
      const middle = (low + high) >> 1;
      if (times[middle] < from) low = middle + 1;
      else high = middle;
    }
    return times.slice(Math.max(0, low - 1));
  }

  /** The last `count` values; angles in degrees, with a gap where they wrap. */
  series(key, path, count, output) {
    const all = this.plots.store.variables.get(key)?.series.get(path) ?? [];
    const values = all.length >= count ? all.slice(all.length - count) : new Array(count).fill(null);
    const isAngle = this.plots.unitOf(key, path).startsWith("rad");
    if (isAngle)
      for (let i = values.length - 1; i >= 0; i--) {
        const wraps = i > 0 && Math.abs(values[i] - values[i - 1]) > Math.PI;
        values[i] = values[i] === null || wraps ? null : values[i] * DEG;
      }
    const last = all.at(-1);
    text(output, typeof last === "number" ? isAngle ? fixed(last * DEG, 1) : number(last) : "–");
    return values;
  }

  remove() {
    this.resized.disconnect();
    this.plot.destroy();
    this.element.remove();
  }
}

const short = (path) => path.replace(/^commands\./, "").replace("starboard", "stbd").replace(/_rad(_s)?$/, "");
const clock = (time) => new Date(time * 1000).toLocaleTimeString("en-GB");

function padded(low, high, span) {
  if (low === null || low === undefined) return [-span, span];
  const pad = Math.max(0.08 * (high - low), (span - (high - low)) / 2, Number.EPSILON);
  return [low - pad, high + pad];
}
