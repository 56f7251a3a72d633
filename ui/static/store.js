// The newest value, age, rate and history of every key on the bus.

export const HISTORY_S = 310;
const HEADER = new Set(["stamp_ns", "seq", "source", "origin_ns"]);

class Variable {
  constructor(key) {
    this.key = key;
    this.value = {};
    this.receivedAt = -Infinity;
    this.rate = NaN;
    this.mark = null; // where counting for the rate began
    this.times = []; // s since 1970, ascending
    this.series = new Map(); // path of a numeric field -> values at `times`
  }

  take(value, now) {
    this.value = value;
    this.receivedAt = now;
    this.count(now);
    this.remember(value.stamp_ns / 1e9);
  }

  /** Rate from the sequence numbers: right even when the page does not get every message. */
  count(now) {
    const { seq, source } = this.value;
    if (!this.mark || this.mark.source !== source || seq < this.mark.seq) {
      this.mark = { seq, source, at: now };
      this.rate = NaN;
    } else if (now - this.mark.at > 1000) {
      this.rate = ((seq - this.mark.seq) * 1000) / (now - this.mark.at);
      this.mark = { seq, source, at: now };
    }
  }

  remember(time) {
    const last = this.times.at(-1) ?? -Infinity;
    if (time < last - 5) this.forget(); // another clock: a restarted simulation
    else if (time <= last) return;
    this.times.push(time);
    for (const [path, value] of numbers(this.value)) {
      let values = this.series.get(path);
      if (!values) this.series.set(path, (values = new Array(this.times.length - 1).fill(null)));
      values.push(value);
    }
    for (const values of this.series.values()) while (values.length < this.times.length) values.push(null);
    if (this.times.length % 256 === 0) this.trim(time - HISTORY_S);
  }

  trim(oldest) {
    const from = this.times.findIndex((t) => t >= oldest);
    if (from <= 0) return;
    this.times.splice(0, from);
    for (const values of this.series.values()) values.splice(0, from);
  }

  forget() {
    this.times = [];
    this.series.clear();
  }
}

/** Every number in a message, [path, value]; dictionaries such as `commands` become `commands.front_port`. */
function* numbers(value) {
  for (const [path, leaf] of leaves(value)) if (typeof leaf === "number") yield [path, leaf];
}

const LONGEST_LIST = 12; // what is longer is no variable to read or plot: corners of a board, a recorded response

/** Every leaf of a message, [path, value], without its header. */
export function* leaves(value, prefix = "") {
  for (const [name, inner] of Object.entries(value)) {
    if (!prefix && HEADER.has(name)) continue;
    if (Array.isArray(inner) && inner.length > LONGEST_LIST) yield [prefix + name, `${inner.length} values`];
    else if (inner !== null && typeof inner === "object") yield* leaves(inner, `${prefix}${name}.`);
    else yield [prefix + name, inner];
  }
}

export class Store {
  constructor() {
    this.variables = new Map();
    this.nowNs = 0;
    this.nowAt = 0;
    this.newAt = -Infinity; // when the bus last brought anything
    this.server = { pages: 0, refused: 0, malformed: 0, dropped: 0 };
    this.version = 0; // changes with every frame that brings values
  }

  apply(frame) {
    const now = performance.now();
    this.nowNs = frame.now_ns || this.nowNs;
    this.nowAt = now;
    this.server = frame.server;
    for (const [key, value] of Object.entries(frame.values)) {
      let variable = this.variables.get(key);
      if (!variable) this.variables.set(key, (variable = new Variable(key)));
      variable.take(value, now);
      this.newAt = now;
      this.version++;
    }
  }

  /** Newest message of a key, or undefined. */
  get(key) {
    return this.variables.get(key)?.value;
  }

  /** Newest message of a key when it arrived less than `limitS` ago, or undefined. */
  fresh(key, limitS) {
    const variable = this.variables.get(key);
    return variable && performance.now() - variable.receivedAt < limitS * 1000 ? variable.value : undefined;
  }

  /** Seconds since a key's content was true, by the server's clock. */
  ageS(key) {
    const stamp = this.get(key)?.stamp_ns;
    return stamp === undefined ? NaN : this.nowS() - stamp / 1e9;
  }

  /** The server's time now, in s since 1970. */
  nowS() {
    return this.nowNs / 1e9 + (performance.now() - this.nowAt) / 1000;
  }

  rate(key) {
    const variable = this.variables.get(key);
    if (!variable) return NaN;
    const silentS = (performance.now() - variable.receivedAt) / 1000;
    return silentS > Math.max(3, 3 / variable.rate || 0) ? 0 : variable.rate;
  }
}
