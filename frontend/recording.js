/**
 * What has been flown, in typed arrays: one time column and one column per subscribed signal, all SI.
 * A bounded ring: when full, the older half is thinned two to one, as the server does.
 * @import {Series} from './types'
 */

const LIMIT = 36000;

export class Recording {
  length = 0;
  #time = new Float64Array(1024);
  /** @type {Map<string, Float64Array>} */
  #columns = new Map();
  /** Signals that have had a value. @type {Set<string>} */
  #known = new Set();

  /** Starts again with these signals. @param {Iterable<string>} names */
  reset(names) {
    this.length = 0;
    this.#known.clear();
    this.#columns = new Map([...names].map((name) => [name, new Float64Array(this.#time.length)]));
  }

  get names() {
    return [...this.#columns.keys()];
  }

  /** Whether a signal has a value anywhere. @param {string} name */
  has(name) {
    return this.#known.has(name);
  }

  get time() {
    return this.#time.subarray(0, this.length);
  }

  get last() {
    return this.length ? this.#time[this.length - 1] : -Infinity;
  }

  /** @param {string} name */
  column(name) {
    return this.#columns.get(name)?.subarray(0, this.length);
  }

  /** Appends the rows newer than the last one. @param {Series} series */
  append(series) {
    let first = 0;
    while (first < series.time.length && series.time[first] <= this.last + 1e-9) first += 1;
    const count = series.time.length - first;
    if (count <= 0) return;
    while (this.length + count > LIMIT && this.length > 2) this.#thin();
    this.#room(this.length + count);
    for (let i = 0; i < count; i += 1) this.#time[this.length + i] = series.time[first + i];
    for (const [name, column] of this.#columns) {
      const values = series.signals[name];
      for (let i = 0; i < count; i += 1) column[this.length + i] = values?.[first + i] ?? NaN;
      if (!this.#known.has(name) && values?.some((value, i) => i >= first && value !== null)) this.#known.add(name);
    }
    this.length += count;
  }

  /** Forgets everything after `time`. @param {number} time */
  truncate(time) {
    while (this.length && this.#time[this.length - 1] > time + 1e-9) this.length -= 1;
    for (const name of this.#known) if (!this.column(name)?.some(Number.isFinite)) this.#known.delete(name);
  }

  /** Index of the last row at or before `time`; -1 before the first. @param {number} time */
  index(time) {
    return searchAfter(this.time, time + 1e-9) - 1;
  }

  /** Value of a signal at the row nearest to `time`; NaN where there is none. @param {string} name @param {number} time */
  at(name, time) {
    const column = this.column(name);
    if (!column || !this.length) return NaN;
    const before = Math.max(0, this.index(time));
    const after = Math.min(this.length - 1, before + 1);
    return column[Math.abs(this.#time[after] - time) < Math.abs(this.#time[before] - time) ? after : before];
  }

  /** @param {number} needed */
  #room(needed) {
    if (needed <= this.#time.length) return;
    const size = Math.max(needed, this.#time.length * 2);
    /** @param {Float64Array} old */
    const grown = (old) => {
      const column = new Float64Array(size);
      column.set(old.subarray(0, this.length));
      return column;
    };
    this.#time = grown(this.#time);
    for (const [name, column] of this.#columns) this.#columns.set(name, grown(column));
  }

  #thin() {
    const half = this.length >> 1;
    for (const column of [this.#time, ...this.#columns.values()]) {
      let to = 0;
      for (let i = 0; i < half; i += 2) column[to++] = column[i];
      column.copyWithin(to, half, this.length);
    }
    this.length = Math.ceil(half / 2) + (this.length - half);
  }
}

/** First index whose time is after `time`. @param {Float64Array} times @param {number} time */
export function searchAfter(times, time) {
  let low = 0;
  let high = times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time) low = middle + 1;
    else high = middle;
  }
  return low;
}

/**
 * Rows to draw of `column[from, to)`: all, or the least and greatest of each of `points / 2` buckets, in order.
 * @param {Float64Array} column
 * @param {number} from
 * @param {number} to
 * @param {number} points
 * @returns {Int32Array}
 */
export function extremes(column, from, to, points) {
  const count = to - from;
  if (count <= points) return Int32Array.from({ length: count }, (_, i) => from + i);
  const buckets = points >> 1;
  const rows = new Int32Array(buckets * 2);
  let kept = 0;
  for (let b = 0; b < buckets; b += 1) {
    const start = from + Math.floor((b * count) / buckets);
    const end = from + Math.floor(((b + 1) * count) / buckets);
    let least = start;
    let greatest = start;
    for (let i = start + 1; i < end; i += 1) {
      if (column[i] < column[least] || Number.isNaN(column[least])) least = i;
      if (column[i] > column[greatest] || Number.isNaN(column[greatest])) greatest = i;
    }
    rows[kept++] = Math.min(least, greatest);
    if (least !== greatest) rows[kept++] = Math.max(least, greatest);
  }
  if (rows[kept - 1] !== to - 1) rows[kept - 1] = to - 1;
  return rows.subarray(0, kept);
}

/**
 * Means of `column[from, to)` over so many equal stretches: shares that sum to one still do. What has no value is left out.
 * @param {Float64Array} column
 * @param {number} from
 * @param {number} to
 * @param {number} stretches
 */
export function means(column, from, to, stretches) {
  const count = Math.min(stretches, to - from);
  return Float64Array.from({ length: Math.max(0, count) }, (_, i) => {
    const end = from + Math.floor(((i + 1) * (to - from)) / count);
    let sum = 0;
    let known = 0;
    for (let row = from + Math.floor((i * (to - from)) / count); row < end; row += 1) {
      if (Number.isNaN(column[row])) continue;
      sum += column[row];
      known += 1;
    }
    return known ? sum / known : NaN;
  });
}

/**
 * Rows at an even stride: for bands, which need a shared time axis.
 * @param {number} from
 * @param {number} to
 * @param {number} points
 */
export function strided(from, to, points) {
  const count = to - from;
  if (count <= points) return Int32Array.from({ length: count }, (_, i) => from + i);
  return Int32Array.from({ length: points }, (_, i) => from + Math.round((i * (count - 1)) / (points - 1)));
}
