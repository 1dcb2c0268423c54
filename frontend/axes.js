/** Value axes that hold still: a range is kept while the data fit it and fill it well. */
import { number } from './format.js';

/** @typedef {{range: [number, number], values: number[], texts: string[], type: string}} Axis */

const SUPERSCRIPT = '⁰¹²³⁴⁵⁶⁷⁸⁹';

/**
 * @param {Float64Array[]} columns what is drawn
 * @param {number[]} ends half-widths of bands at their right end, kept in view
 * @param {[number, number] | null} before
 * @returns {Axis}
 */
export function linearAxis(columns, ends, before) {
  let low = Infinity;
  let high = -Infinity;
  for (const column of columns) {
    for (const value of column) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  for (const end of ends) {
    if (!Number.isFinite(end)) continue;
    low = Math.min(low, -end);
    high = Math.max(high, end);
  }
  if (low > high && !before) return { range: [-1, 1], values: [], texts: [], type: 'linear' };
  if (low > high) [low, high] = before ?? [-1, 1];
  if (high - low < 1e-12 * Math.max(Math.abs(high), 1e-3)) [low, high] = [low - (Math.abs(low) || 1) * 0.1, high + (Math.abs(high) || 1) * 0.1];
  const fits = before && low >= before[0] && high <= before[1] && high - low > 0.45 * (before[1] - before[0]);
  const range = fits ? before : wide(low, high);
  const step = roundStep((range[1] - range[0]) / 4);
  const values = [];
  for (let i = Math.ceil(range[0] / step - 1e-9); i * step <= range[1] + step * 1e-9; i += 1) values.push(i * step);
  return { range, values, texts: values.map((v) => number(Number(v.toPrecision(6)), 4)), type: 'linear' };
}

/** From zero to the highest pile; shares that sum to one get exactly that. @param {Float64Array[]} columns @param {[number, number] | null} before @returns {Axis} */
export function stackAxis(columns, before) {
  let high = 0;
  for (let i = 0; i < (columns[0]?.length ?? 0); i += 1) {
    const pile = columns.reduce((sum, column) => sum + (column[i] || 0), 0);
    if (pile > high) high = pile;
  }
  if (high <= 1.001) return { range: [0, 1], values: [0, 0.5, 1], texts: ['0', '0.5', '1'], type: 'linear' };
  return linearAxis([Float64Array.of(0, high)], [], before);
}

/** Words for the numbers 0, 1, 2 ... @param {readonly string[]} levels @returns {Axis} */
export function levelAxis(levels) {
  return { range: [-0.35, levels.length - 0.1], values: levels.map((_, i) => i), texts: levels.map(() => ''), type: 'linear' };
}

/** @param {number} low @param {number} high @returns {[number, number]} */
function wide(low, high) {
  const room = 0.12 * (high - low);
  return [low >= 0 && low < room ? Math.min(0, low) - 0.02 * (high - low) : low - room, high + room];
}

/** @param {number} rough */
function roundStep(rough) {
  const power = 10 ** Math.floor(Math.log10(rough));
  const lead = rough / power;
  return power * (lead > 7 ? 10 : lead > 3.5 ? 5 : lead > 1.6 ? 2 : 1);
}

/**
 * Whole decades, from nearly the least to the greatest value; stray tiny statistics do not stretch it.
 * @param {Float64Array[]} columns
 * @param {[number, number] | null} before
 * @returns {Axis}
 */
export function logAxis(columns, before) {
  let high = -Infinity;
  const smallest = [];
  for (const column of columns) {
    const positive = column.filter((v) => v > 0 && Number.isFinite(v)).sort();
    if (!positive.length) continue;
    smallest.push(positive[Math.floor(positive.length * 0.03)]);
    high = Math.max(high, positive[positive.length - 1]);
  }
  if (!smallest.length) return logTicks(before ?? [0, 2]);
  const top = Math.log10(high);
  const bottom = Math.max(Math.log10(Math.min(...smallest)), top - 6);
  const fits = before && bottom >= before[0] && top <= before[1] && top - bottom > 0.5 * (before[1] - before[0]);
  return logTicks(fits ? before : [Math.floor(bottom), Math.max(Math.ceil(top + 0.05), Math.floor(bottom) + 1)]);
}

/** @param {[number, number]} range @returns {Axis} */
function logTicks(range) {
  const decades = range[1] - range[0];
  const every = decades > 4 ? 2 : 1;
  // One or two decades alone would leave an axis with one or two numbers on it.
  const between = decades <= 1 ? [2, 5] : decades <= 2 ? [3] : [];
  const values = [];
  const texts = [];
  for (let d = Math.ceil(range[0]); d <= range[1]; d += every) {
    values.push(10 ** d);
    texts.push(decade(d));
    for (const part of d < range[1] ? between : []) {
      values.push(part * 10 ** d);
      texts.push(number(Number((part * 10 ** d).toPrecision(1)), 1));
    }
  }
  return { range, values, texts, type: 'log' };
}

/** @param {number} d */
function decade(d) {
  if (d >= -2 && d <= 3) return String(Number((10 ** d).toPrecision(1)));
  return `10${d < 0 ? '⁻' : ''}${[...String(Math.abs(d))].map((c) => SUPERSCRIPT[Number(c)]).join('')}`;
}
