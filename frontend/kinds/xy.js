/** One signal over another, a point an epoch, up to the moment; regions tell what a place means, and how many are there. */
import { linearAxis } from '../axes.js';
import { clock, number, unitText } from '../format.js';
import { searchAfter } from '../recording.js';
import { recording } from '../session.js';
import { color, style, tint } from '../traces.js';
/** @import {Chart, Trace} from '../types' */
/** @import {Moment, Frame, Picture} from '../moments' */

const LEFT = 42;
const RIGHT = 8;
const TOP = 6;
const BOTTOM = 29;
const LIVE_POINTS = 300;
const STILL_POINTS = 1500;
const SHEET_ROWS = 500;
/** Points nearer to each other than this are one [px]. */
const CELL = 2;
/** How far beyond its limit a chart reaches, at least and at most. */
const BEYOND = [1.3, 2.5];
/** @type {Record<string, [string, number]>} */
const SHADES = { ok: ['good', 0.09], suspect: ['alarm', 0.12], faulted: ['fault', 0.2], isolated: ['isolated', 0.12], off: ['edge', 0.14] };

/** @typedef {{trace: Trace, rows: Int32Array, first: number, last: number, counts: number[], total: number}} Cloud */

/** @param {Moment} moment @param {Frame} frame @returns {Picture} */
export function drawXy(moment, frame) {
  const { chart } = moment;
  const unit = unitText(chart.unit);
  const last = searchAfter(recording.time, moment.time + 1e-9) - 1;
  const first = Math.max(0, searchAfter(recording.time, frame.range[0] - 1e-9));
  const clouds = chart.traces.filter((t) => t.role !== 'threshold').map((trace) => gather(trace, first, last, chart, frame.live ? LIVE_POINTS : STILL_POINTS));
  const limit = moment.value(chart.limit);
  const span = axes(moment, clouds, limit);
  const data = [];
  let beyond = 0;
  const cell = { x: ((span.x[1] - span.x[0]) / moment.size.width) * CELL, y: ((span.y[1] - span.y[0]) / moment.size.height) * CELL };
  for (const { trace, rows } of clouds) {
    const look = style(chart, trace);
    const [allX, allY] = [shown(moment, trace.across, rows, span.x[1]), shown(moment, trace.signal, rows, span.y[1])];
    beyond += allX.out.filter((out, i) => out || allY.out[i]).length;
    const [x, y] = apart(allX, allY, cell);
    data.push({
      type: 'scatter', mode: 'markers', x: x.values, y: y.values, cliponaxis: false,
      marker: { size: 4.5, color: look.color, opacity: 0.7, symbol: x.out.map((out, i) => (out ? 'triangle-right' : y.out[i] ? 'triangle-up' : 'circle')) },
    });
    data.push({
      type: 'scatter', mode: 'markers', x: [Math.min(moment.value(trace.across), span.x[1])], y: [Math.min(moment.value(trace.signal), span.y[1])], cliponaxis: false,
      marker: { size: 11, color: 'rgba(0,0,0,0)', line: { color: color('ink'), width: 2 } },
    });
  }
  const corner = { zero: () => 0, limit: () => limit, end: (/** @type {'x' | 'y'} */ way) => span[way][1] };
  const regions = Number.isFinite(limit) ? chart.regions : [];
  const [counted] = clouds;
  const labels = regions.map((region, i) => {
    const points = region.corners.map(([x, y]) => [corner[x]('x'), corner[y]('y')]);
    const share = counted?.total ? `<br><b>${counted.counts[i]}</b>` : '';
    return { points, text: `${region.label}${share}`, x: mean(points.map((p) => p[0])), y: mean(points.map((p) => p[1])), health: region.health };
  });
  data.push({ type: 'scatter', mode: 'text', x: labels.map((l) => l.x), y: labels.map((l) => l.y), text: labels.map((l) => l.text), textfont: { size: 10.5, color: color('ink') } });
  const grid = { gridcolor: color('grid'), zeroline: false, fixedrange: true, ticks: '', tickmode: 'array' };
  const rule = { type: 'line', line: { color: color('ink'), width: 1, dash: '7px,4px' }, opacity: 0.75 };
  return {
    data,
    layout: {
      margin: { l: LEFT, r: RIGHT, t: TOP, b: BOTTOM },
      shapes: [
        ...labels.map((l) => ({ type: 'path', layer: 'below', path: `M${l.points.map((p) => p.join(' ')).join('L')}Z`, fillcolor: tint(color(SHADES[l.health][0]), SHADES[l.health][1]), line: { width: 0 } })),
        ...(Number.isFinite(limit) ? [{ ...rule, x0: 0, x1: span.x[1], y0: limit, y1: limit }, { ...rule, x0: limit, x1: limit, y0: 0, y1: span.y[1] }] : []),
      ],
      xaxis: { ...grid, range: span.x, tickvals: span.xTicks.values, ticktext: span.xTicks.texts, title: { text: titled(chart.across, unit), standoff: 2, font: { size: 10.5 } } },
      yaxis: { ...grid, range: span.y, tickvals: span.yTicks.values, ticktext: span.yTicks.texts, title: { text: titled(chart.upward, unit), standoff: 2, font: { size: 10.5 } } },
    },
    targets: [],
    words: words(moment, clouds, unit, beyond),
    sheet: sheet(moment, clouds, unit),
  };
}

/** Rows to draw and what they count for: what counts for another region than the first is never left out. @param {Trace} trace @param {number} first @param {number} last @param {Chart} chart @param {number} points @returns {Cloud} */
function gather(trace, first, last, chart, points) {
  const code = recording.column(trace.code ?? '');
  const counts = chart.regions.map(() => 0);
  let total = 0;
  /** @type {number[]} */
  const special = [];
  /** @type {number[]} */
  const plain = [];
  for (let row = first; row <= last; row += 1) {
    const region = code ? code[row] : NaN;
    if (region >= 0 && region < counts.length) {
      counts[region] += 1;
      total += 1;
    }
    (region > 0 ? special : plain).push(row);
  }
  const kept = [...thinned(special, points / 2), ...thinned(plain, points / 2)].sort((a, b) => a - b);
  return { trace, rows: Int32Array.from(kept), first, last, counts, total };
}

/** @param {number[]} rows @param {number} most */
function thinned(rows, most) {
  const stride = Math.max(1, Math.ceil(rows.length / most));
  return rows.filter((_, i) => i % stride === 0);
}

/** Values as shown; those beyond the axis stand at its end. @param {Moment} moment @param {string | null} signal @param {Int32Array} rows @param {number} end */
function shown(moment, signal, rows, end) {
  const column = recording.column(signal ?? '');
  const factor = moment.factor(signal ?? '');
  const raw = [...rows].map((row) => (column ? column[row] / factor : NaN));
  return { values: raw.map((v) => Math.min(v, end)), out: raw.map((v) => v > end) };
}

/** @typedef {{values: number[], out: boolean[]}} Coordinate */

/** One point of all that would be drawn on top of each other. @param {Coordinate} x @param {Coordinate} y @param {{x: number, y: number}} cell @returns {[Coordinate, Coordinate]} */
function apart(x, y, cell) {
  /** @type {Set<string>} */
  const taken = new Set();
  const kept = x.values.map((_, i) => i).filter((i) => {
    const key = `${Math.round(x.values[i] / cell.x)}/${Math.round(y.values[i] / cell.y)}`;
    if (key.includes('NaN') || taken.has(key)) return false;
    taken.add(key);
    return true;
  });
  const only = (/** @type {Coordinate} */ one) => ({ values: kept.map((i) => one.values[i]), out: kept.map((i) => one.out[i]) });
  return [only(x), only(y)];
}

/** @param {Moment} moment @param {Cloud[]} clouds @param {number} limit */
function axes(moment, clouds, limit) {
  const spread = (/** @type {(t: Trace) => string | null} */ of) => clouds.flatMap(({ trace, rows }) => {
    const column = recording.column(of(trace) ?? '');
    const factor = moment.factor(of(trace) ?? '');
    return column ? [...rows].map((row) => column[row] / factor).filter(Number.isFinite) : [];
  });
  const xs = spread((t) => t.across);
  const ys = spread((t) => t.signal);
  if (!Number.isFinite(limit)) {
    const x = linearAxis([Float64Array.from(xs)], [], null);
    const y = linearAxis([Float64Array.from(ys)], [], null);
    return { x: x.range, y: y.range, xTicks: x, yTicks: y };
  }
  const reach = Math.max(1, ...xs.concat(ys).map((v) => (1.05 * v) / limit));
  // Whole steps: the picture stands still while points come in.
  const end = limit * Math.min(BEYOND[1], Math.max(BEYOND[0], Math.ceil(reach * 4) / 4));
  const ticks = linearAxis([Float64Array.of(0, end)], [], [0, end]);
  const range = /** @type {[number, number]} */ ([0, end]);
  return { x: range, y: range, xTicks: ticks, yTicks: ticks };
}

/** @param {Moment} moment @param {Cloud[]} clouds @param {string} unit @param {number} beyond */
function words(moment, clouds, unit, beyond) {
  const [cloud] = clouds;
  if (!cloud || cloud.last < cloud.first) return '';
  const region = moment.chart.regions[recording.at(cloud.trace.code ?? '', moment.time)];
  const at = `${number(moment.value(cloud.trace.across))}, ${number(moment.value(cloud.trace.signal))} ${unit}`.trim();
  return `${at}${region ? `: ${region.label}` : ''}${beyond ? `; ${beyond} beyond the axes` : ''}`;
}

/** @param {Moment} moment @param {Cloud[]} clouds @param {string} unit */
function sheet(moment, clouds, unit) {
  const { chart } = moment;
  const [cloud] = clouds;
  if (!cloud) return { caption: '', head: [], rows: [] };
  const counted = chart.regions.map((r, i) => `${r.label} ${cloud.counts[i]}`).join(', ');
  const x = recording.column(cloud.trace.across ?? '');
  const y = recording.column(cloud.trace.signal);
  const code = recording.column(cloud.trace.code ?? '');
  const stride = Math.max(1, Math.ceil((cloud.last - cloud.first + 1) / SHEET_ROWS));
  const rows = [];
  for (let i = cloud.first; i <= cloud.last; i += stride) {
    rows.push([clock(recording.time[i], 1), number((x?.[i] ?? NaN) / moment.factor(cloud.trace.across ?? ''), 4), number((y?.[i] ?? NaN) / moment.factor(cloud.trace.signal), 4), chart.regions[code?.[i] ?? -1]?.label ?? '']);
  }
  return { caption: `${cloud.total} epochs: ${counted}`, head: ['time', titled(chart.across, unit), titled(chart.upward, unit), 'region'], rows };
}

/** @param {string} text @param {string} unit */
const titled = (text, unit) => (unit ? `${text}, ${unit}` : text);

/** @param {number[]} values */
const mean = (values) => values.reduce((sum, v) => sum + v, 0) / values.length;
