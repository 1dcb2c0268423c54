/**
 * Charts of one moment: points over a plane, the sky, bars. They show the cursor's epoch, or the newest one. Each kind says
 * what to draw, what a person can point at, what it comes to in words, and the numbers behind it.
 * @import {Chart, Health, SystemDescription, Trace} from './types'
 */
import { HEALTH } from './health.js';
import { drawBars } from './kinds/bars.js';
import { drawSky } from './kinds/sky.js';
import { drawXy } from './kinds/xy.js';
import { recording } from './session.js';
import { store } from './store.js';
import { color } from './traces.js';

/** @typedef {{trace: Trace, x: number, y: number, width: number, height: number, label: string, channel: string}} Target */
/** @typedef {{caption: string, head: string[], rows: (string | number)[][]}} Sheet */
/**
 * @typedef {object} Picture
 * @property {object[]} data plotly traces
 * @property {Record<string, any>} layout what differs from the common layout
 * @property {Target[]} targets what can be pointed at
 * @property {string} words what it comes to
 * @property {Sheet} sheet the numbers behind it
 */
/** @typedef {{range: [number, number], live: boolean, ghost: boolean}} Frame */

/** @type {Record<string, (moment: Moment, frame: Frame) => Picture>} */
const KINDS = { xy: drawXy, sky: drawSky, bars: drawBars };

/** How a marker looks by health; the shapes are those of the diagram. @type {Record<Health, {color: string, symbol: string, hatch: string}>} */
const LOOKS = {
  ok: { color: 'series-1', symbol: 'circle', hatch: '' },
  faulted: { color: 'fault', symbol: 'diamond', hatch: '/' },
  suspect: { color: 'alarm', symbol: 'triangle-up', hatch: 'x' },
  isolated: { color: 'isolated', symbol: 'square-open', hatch: '-' },
  off: { color: 'edge', symbol: 'circle-open', hatch: '.' },
};

export class Moment {
  #revision = 0;
  /** Range of an axis that holds still. @type {[number, number] | null} */
  held = null;

  /** @param {HTMLElement} host @param {Chart} chart @param {SystemDescription} description */
  constructor(host, chart, description) {
    this.host = host;
    this.chart = chart;
    this.factors = new Map(description.signals.map((s) => [s.name, s.factor]));
    this.channels = new Map(description.scene.map((item) => [item.id, item.channel]));
  }

  get size() {
    return { width: this.host.clientWidth, height: this.host.clientHeight };
  }

  /** The moment that is shown [s]. */
  get time() {
    const { cursor, now } = store.get();
    return cursor ?? now;
  }

  /** Draws, and says what was drawn; null before there is room or a library. @param {Frame} frame @returns {Picture | null} */
  draw(frame) {
    const { width, height } = this.size;
    if (!window.Plotly || width < 60 || height < 60) return null;
    const picture = KINDS[this.chart.kind](this, frame);
    this.#revision += 1;
    void window.Plotly.react(this.host, picture.data, {
      width, height, margin: { l: 0, r: 0, t: 0, b: 0 }, paper_bgcolor: 'rgba(0,0,0,0)', plot_bgcolor: 'rgba(0,0,0,0)',
      showlegend: false, hovermode: false, dragmode: false, datarevision: this.#revision, uirevision: this.chart.id,
      font: { family: 'system-ui, "DejaVu Sans", sans-serif', size: 10.5, color: color('dim') }, ...picture.layout,
    }, { staticPlot: true, displayModeBar: false });
    return picture;
  }

  /** Value of a signal at the moment, as it is shown. @param {string | null | undefined} signal */
  value(signal) {
    return signal ? recording.at(signal, this.time) / this.factor(signal) : NaN;
  }

  /** @param {string} signal */
  factor(signal) {
    return this.factors.get(signal) ?? 1;
  }

  /** Traces of the moment that have a value anywhere in the run. */
  present() {
    return this.chart.traces.filter((t) => recording.has(t.signal));
  }

  /** @param {Trace} trace @returns {Health} */
  health(trace) {
    const { cursor, view, pastView } = store.get();
    const seen = cursor === null ? view : (pastView ?? view);
    return (trace.item && seen?.items?.[trace.item]?.health) || 'ok';
  }

  /** @param {Trace} trace */
  look(trace) {
    const health = this.health(trace);
    const { color: name, symbol, hatch } = LOOKS[health];
    return { health, color: color(name), symbol, hatch, word: HEALTH[health].word };
  }

  /** Channel that pointing at a trace selects. @param {Trace} trace */
  channel(trace) {
    return (trace.item && this.channels.get(trace.item)) || '';
  }

  erase() {
    window.Plotly?.purge(this.host);
  }
}
