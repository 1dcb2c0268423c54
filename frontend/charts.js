/**
 * One chart drawn by plotly.js, and the queue that draws them: one dirty, visible chart per animation frame, and never
 * more than a share of the time, so that the page stays quick however many charts are live.
 * @import {Chart, SystemDescription, Trace} from './types'
 */
import { ghostRecording } from './ghost.js';
import { extremes, means, searchAfter, strided } from './recording.js';
import { recording } from './session.js';
import { levelAxis, linearAxis, logAxis, stackAxis } from './axes.js';
import { timeTicks } from './format.js';
import { color, style, tint } from './traces.js';

export const MARGIN = { left: 54, right: 14, top: 5, bottom: 5 };
const LIVE_POINTS = 300;
const STILL_POINTS = 6000;
/** With more lines than this only those that have values are told of. */
export const MANY = 6;
/** A limit so many times as far from zero as the data leaves the chart, and comes back when it is nearer again. */
const AWAY = 30;
const BACK = 20;
/** How far apart lines of the same level are drawn [levels]. */
const BESIDE = 0.055;

/** @type {Promise<void> | null} */
let plotly = null;

/** Fetches plotly.js once, beside everything else. */
export function loadPlotly() {
  plotly ??= new Promise((resolve, reject) => {
    const script = document.createElement('script');
    script.src = '/vendor/plotly.min.js';
    script.async = true;
    script.onload = () => resolve();
    script.onerror = () => reject(new Error('The chart library could not be loaded.'));
    document.head.append(script);
  });
  return plotly;
}

/** @typedef {{range: [number, number], live: boolean, ghost: boolean}} Frame */

export class Drawing {
  #revision = 0;
  /** @type {[number, number] | null} */
  #yRange = null;
  /** Signals the person has switched off in the legend. @type {Set<string>} */
  hidden = new Set();
  /** Limits too far from the data to be drawn with them; the legend tells their values. @type {Set<string>} */
  beyond = new Set();
  /** Where many lines are declared and few have values: the order in which they came, which gives them their colours. @type {Map<string, number>} */
  #places = new Map();

  /** @param {HTMLElement} host @param {Chart} chart @param {SystemDescription} description */
  constructor(host, chart, description) {
    this.host = host;
    this.chart = chart;
    this.factor = description.signals.find((s) => s.name === chart.traces[0]?.signal)?.factor ?? 1;
    this.factors = new Map(description.signals.map((s) => [s.name, s.factor]));
  }

  /** Traces that have a value anywhere in the run; all of them while nothing is known. */
  present() {
    const { traces } = this.chart;
    return recording.length || traces.length > MANY ? traces.filter((t) => recording.has(t.signal)) : traces;
  }

  /** @param {Trace} trace */
  style(trace) {
    if (this.chart.traces.length <= MANY) return style(this.chart, trace);
    const known = this.#places.get(trace.signal) ?? this.#places.size;
    this.#places.set(trace.signal, known);
    return style(this.chart, trace, known);
  }

  /** @param {Frame} frame */
  draw(frame) {
    const { clientWidth: width, clientHeight: height } = this.host;
    if (!window.Plotly || width < 80) return;
    const time = recording.time;
    const from = Math.max(0, searchAfter(time, frame.range[0]) - 1);
    const to = Math.min(time.length, searchAfter(time, frame.range[1]) + 1);
    const points = frame.live ? LIVE_POINTS : STILL_POINTS;
    const traces = this.present().filter((t) => !this.hidden.has(t.signal));
    // A stack finer than the screen would be stripes; its means are what can be seen of it.
    const stretches = this.chart.stacked ? Math.min(points, Math.round(width / 2)) : 0;
    const middles = stretches ? means(time, from, to, stretches) : null;
    const data = [];
    /** @type {Float64Array[]} */
    const extents = [];
    /** @type {Map<string, Float64Array>} */
    const limits = new Map();
    /** @type {number[]} */
    const ends = [];
    for (const trace of traces) {
      const sigma = trace.sigma ? recording.column(trace.sigma) : undefined;
      if (!sigma || trace.role === 'local') continue;
      const rows = strided(from, to, points);
      const x = pick(time, rows, 1);
      const upper = pick(sigma, rows, 3 / this.#scale(trace.sigma));
      const lower = upper.map((v) => -v);
      const band = { type: 'scatter', mode: 'lines', x, line: { width: 0 } };
      data.push({ ...band, y: lower }, { ...band, y: upper, fill: 'tonexty', fillcolor: tint(this.style(trace).color, 0.13) });
      if (upper.length) ends.push(upper[upper.length - 1]);
    }
    for (const trace of frame.ghost ? haunted(traces) : []) {
      const column = ghostRecording.column(trace.signal);
      if (!column?.length) continue;
      const rows = this.#rows(ghostRecording.time, column, frame.range, points);
      const look = this.style(trace);
      const y = pick(column, rows, 1 / this.#scale(trace.signal));
      data.push(line(pick(ghostRecording.time, rows, 1), y, { ...look, width: 4, dash: 'solid', opacity: 0.35 }));
      extents.push(y);
    }
    for (const trace of [...traces].reverse()) {
      const column = recording.column(trace.signal);
      if (!column) continue;
      const rows = trace.role === 'threshold' || middles ? strided(from, to, points) : extremes(column, from, to, points);
      const y = middles ? means(column, from, to, stretches).map((v) => v / this.#scale(trace.signal)) : pick(column, rows, 1 / this.#scale(trace.signal));
      // Nothing at or below zero has a place on a logarithmic axis; a gap is more honest than a plunge.
      if (this.chart.scale === 'log') for (let i = 0; i < y.length; i += 1) if (y[i] <= 0) y[i] = NaN;
      if (!y.some(Number.isFinite)) continue;
      const look = this.style(trace);
      // Steps that coincide would hide each other: each line keeps a little beside its level.
      if (this.chart.levels.length) for (let i = 0; i < y.length; i += 1) y[i] += BESIDE * (traces.indexOf(trace) - (traces.length - 1) / 2);
      const drawn = line(middles ?? pick(time, rows, 1), y, this.chart.levels.length ? { ...look, shape: 'hv' } : look);
      data.push(this.chart.stacked ? { ...drawn, stackgroup: 'all', fillcolor: tint(look.color, 0.6), fillpattern: hatch(look), line: { ...drawn.line, width: 0 } } : drawn);
      if (trace.role === 'threshold') limits.set(trace.signal, y);
      else extents.push(y);
    }
    this.#near(extents, limits);
    const axis = this.#axis(extents, ends);
    this.#yRange = axis.range;
    if (this.chart.levels.length) data.push(named(this.chart.levels, frame.range[0]));
    this.#revision += 1;
    void window.Plotly.react(this.host, data, this.#layout(frame, axis, width, height), { staticPlot: true, displayModeBar: false });
  }

  /** @param {string | null} signal */
  #scale(signal) {
    return this.factors.get(signal ?? '') ?? this.factor;
  }

  /** @param {Float64Array} time @param {Float64Array} column @param {[number, number]} range @param {number} points */
  #rows(time, column, range, points) {
    return extremes(column, Math.max(0, searchAfter(time, range[0]) - 1), Math.min(time.length, searchAfter(time, range[1]) + 1), points);
  }

  /** Lets a limit widen a linear axis, unless it is so far away that the data would be a flat line. @param {Float64Array[]} extents @param {Map<string, Float64Array>} limits */
  #near(extents, limits) {
    const data = Math.max(0, ...extents.map(reach));
    for (const [signal, column] of limits) {
      const times = data > 0 && this.chart.scale === 'linear' ? reach(column) / data : 0;
      if (times > (this.beyond.has(signal) ? BACK : AWAY)) this.beyond.add(signal);
      else {
        this.beyond.delete(signal);
        extents.push(column);
      }
    }
  }

  /** @param {Float64Array[]} extents @param {number[]} ends */
  #axis(extents, ends) {
    if (this.chart.levels.length) return levelAxis(this.chart.levels);
    if (this.chart.stacked) return stackAxis(extents, this.#yRange);
    return this.chart.scale === 'log' ? logAxis(extents, this.#yRange) : linearAxis(extents, ends, this.#yRange);
  }

  /** @param {Frame} frame @param {import('./axes.js').Axis} axis @param {number} width @param {number} height */
  #layout(frame, axis, width, height) {
    const grid = { gridcolor: color('grid'), gridwidth: 1, zeroline: false, fixedrange: true, showline: false, ticks: '' };
    return {
      width, height, margin: { l: MARGIN.left, r: MARGIN.right, t: MARGIN.top, b: MARGIN.bottom },
      paper_bgcolor: 'rgba(0,0,0,0)', plot_bgcolor: 'rgba(0,0,0,0)', showlegend: false, hovermode: false, dragmode: false,
      datarevision: this.#revision, uirevision: this.chart.id, font: { family: 'system-ui, "DejaVu Sans", sans-serif', size: 10.5, color: color('dim') },
      xaxis: { ...grid, range: frame.range, tickmode: 'array', tickvals: timeTicks(...frame.range, 10), showticklabels: false },
      yaxis: { ...grid, type: axis.type, range: axis.range, tickmode: 'array', tickvals: axis.values, ticktext: axis.texts },
    };
  }

  erase() {
    window.Plotly?.purge(this.host);
  }
}

/** Traces that have a ghost: the protected ones where there are some, else all but thresholds. @param {Trace[]} traces */
export function haunted(traces) {
  const guarded = traces.filter((t) => t.role === 'protected');
  return guarded.length ? guarded : traces.filter((t) => t.role !== 'threshold' && t.role !== 'weight');
}

/** Areas of one colour are told apart as lines are: by what would be a dash. @param {import('./traces.js').Style} look */
function hatch(look) {
  return look.dash === 'solid' ? {} : { shape: '/', fgcolor: color('panel'), size: 7, solidity: 0.4, fillmode: 'overlay' };
}

/** Words of levels, inside the chart: beside it there is room for numbers only. @param {readonly string[]} levels @param {number} from */
function named(levels, from) {
  return {
    type: 'scatter', mode: 'text', x: levels.map(() => from), y: levels.map((_, i) => i + 2 * BESIDE), text: levels.map((word) => ` ${word}`),
    textposition: 'top right', textfont: { size: 10.5, color: color('dim') },
  };
}

/** @param {Float64Array} x @param {Float64Array} y @param {import('./traces.js').Style & {shape?: string}} look */
function line(x, y, look) {
  return {
    type: 'scatter', mode: 'lines', x, y, opacity: look.opacity, connectgaps: false,
    line: { color: look.color, width: look.width, dash: look.dash, shape: look.shape ?? 'linear', simplify: false },
  };
}

/** How far from zero a column goes. @param {Float64Array} column */
function reach(column) {
  let most = 0;
  for (const value of column) if (Math.abs(value) > most) most = Math.abs(value);
  return most;
}

/** @param {Float64Array} column @param {Int32Array} rows @param {number} scale */
function pick(column, rows, scale) {
  const values = new Float64Array(rows.length);
  for (let i = 0; i < rows.length; i += 1) values[i] = column[rows[i]] * scale;
  return values;
}
