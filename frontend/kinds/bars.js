/** A bar a trace, at the moment; thresholds are lines across. */
import { linearAxis } from '../axes.js';
import { number, unitText } from '../format.js';
import { color } from '../traces.js';
/** @import {Moment, Frame, Picture} from '../moments' */

const LEFT = 36;
const RIGHT = 8;
const TOP = 6;
const BOTTOM = 17;

/** @param {Moment} moment @param {Frame} _frame @returns {Picture} */
export function drawBars(moment, _frame) {
  const { width, height } = moment.size;
  const unit = unitText(moment.chart.unit);
  const bars = moment.present().filter((t) => t.role !== 'threshold').map((trace) => ({ trace, value: moment.value(trace.signal), ...moment.look(trace) }));
  const limits = moment.chart.traces.filter((t) => t.role === 'threshold').map((trace) => ({ trace, value: moment.value(trace.signal) })).filter((l) => Number.isFinite(l.value));
  const signed = bars.some((b) => b.value < 0);
  const lines = limits.flatMap((l) => (signed ? [l.value, -l.value] : [l.value]));
  const axis = linearAxis([Float64Array.of(...(bars.length ? [0] : []), ...bars.map((b) => b.value), ...lines)], [], moment.held);
  moment.held = axis.range;
  const ends = [-0.6, Math.max(bars.length, 1) - 0.4];
  const inner = width - LEFT - RIGHT;
  const step = inner / (ends[1] - ends[0]);
  const largest = bars.reduce((/** @type {typeof bars[0] | null} */ most, b) => (Math.abs(b.value) > Math.abs(most?.value ?? 0) ? b : most), null);
  const grid = { gridcolor: color('grid'), zeroline: false, fixedrange: true, ticks: '' };
  const tell = (/** @type {number} */ value) => [number(value), unit].filter(Boolean).join(' ');
  return {
    data: [
      {
        type: 'bar', x: bars.map((_, i) => i), y: bars.map((b) => b.value), width: 0.68,
        marker: { color: bars.map((b) => b.color), line: { width: 0 }, pattern: { shape: bars.map((b) => b.hatch), fillmode: 'replace', fgcolor: bars.map((b) => b.color), size: 5, solidity: 0.45 } },
      },
      ...lines.map((value) => ({ type: 'scatter', mode: 'lines', x: ends, y: [value, value], line: { color: color('ink'), width: 1, dash: '7px,4px' }, opacity: 0.75 })),
    ],
    layout: {
      margin: { l: LEFT, r: RIGHT, t: TOP, b: BOTTOM }, bargap: 0,
      shapes: [{ type: 'line', x0: ends[0], x1: ends[1], y0: 0, y1: 0, line: { color: color('edge'), width: 1 } }],
      xaxis: { ...grid, showgrid: false, range: ends, tickmode: 'array', tickvals: bars.map((_, i) => i), ticktext: bars.map((b) => (b.health === 'isolated' ? `(${b.trace.label})` : b.trace.label)), tickangle: step < 20 ? -90 : 0 },
      yaxis: { ...grid, range: axis.range, tickmode: 'array', tickvals: axis.values, ticktext: axis.texts },
    },
    targets: bars.map((b, i) => ({
      trace: b.trace, x: LEFT + (i - 0.5 - ends[0]) * step, y: 0, width: step, height, channel: moment.channel(b.trace), label: `${b.trace.label}: ${tell(b.value)}, ${b.word}`,
    })),
    words: largest ? `largest: ${largest.trace.label} ${tell(largest.value)}${limits.length ? `, ${limits.map((l) => `${l.trace.label} ${number(l.value)}`).join(', ')}` : ''}` : '',
    sheet: {
      caption: unit ? `values in ${unit}` : '', head: ['', 'value', 'health'],
      rows: [...bars.map((b) => [b.trace.label, number(b.value, 4), b.word]), ...limits.map((l) => [l.trace.label, number(l.value, 4), ''])],
    },
  };
}
