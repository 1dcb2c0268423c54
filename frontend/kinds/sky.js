/** The sky from below: north up, east right, the zenith in the middle; markers tell each satellite's health. */
import { number } from '../format.js';
import { searchAfter, strided } from '../recording.js';
import { recording } from '../session.js';
import { color } from '../traces.js';
/** @import {Moment, Frame, Picture} from '../moments' */

const RIM = 15;
const TRACK_POINTS = 40;
/** A track shorter than this share of the radius is not worth a line. */
const LEAST_TRACK = 0.03;
const REACH = 22;

/** @param {Moment} moment @param {Frame} frame @returns {Picture} */
export function drawSky(moment, frame) {
  const { width, height } = moment.size;
  const radius = Math.min(width, height) / 2 - RIM;
  const placed = moment.present().map((trace) => {
    const elevation = moment.value(trace.signal);
    const azimuth = ((moment.value(trace.across) % 360) + 360) % 360;
    return { trace, elevation, azimuth, ...moment.look(trace), ...place(elevation, azimuth) };
  }).filter((s) => Number.isFinite(s.x) && s.elevation >= 0);
  const ring = (/** @type {number} */ r) => ({ type: 'circle', x0: -r, x1: r, y0: -r, y1: r, line: { color: color(r === 1 ? 'edge' : 'line'), width: 1 } });
  const spoke = (/** @type {number} */ x, /** @type {number} */ y) => ({ type: 'line', x0: -x, x1: x, y0: -y, y1: y, line: { color: color('line'), width: 1 } });
  const words = { type: 'scatter', mode: 'text', cliponaxis: false, textfont: { size: 9.5, color: color('dim') } };
  const edge = 1 + 8 / radius;
  const data = [
    tracks(moment, frame),
    { ...words, x: [0, edge, 0, -edge], y: [edge, 0, -edge, 0], text: ['N', 'E', 'S', 'W'] },
    { ...words, x: [0, 0], y: [2 / 3, 1 / 3], text: ['30°', '60°'], textposition: 'bottom left' },
    {
      type: 'scatter', mode: 'markers+text', cliponaxis: false, x: placed.map((s) => s.x), y: placed.map((s) => s.y), text: placed.map((s) => s.trace.label),
      textposition: placed.map((s) => (s.x > 0.75 ? 'middle left' : 'middle right')), textfont: { size: 10.5, color: color('ink') },
      marker: { size: placed.map((s) => (s.health === 'ok' ? 8 : 11)), symbol: placed.map((s) => s.symbol), color: placed.map((s) => s.color), line: { width: 1.6, color: placed.map((s) => s.color) } },
    },
  ];
  const out = placed.filter((s) => s.health === 'isolated' || s.health === 'off').length;
  const axis = { visible: false, fixedrange: true };
  return {
    data,
    layout: {
      shapes: [spoke(0, 1), spoke(1, 0), ring(1), ring(2 / 3), ring(1 / 3)],
      xaxis: { ...axis, range: [-width / 2 / radius, width / 2 / radius] }, yaxis: { ...axis, range: [-height / 2 / radius, height / 2 / radius] },
    },
    targets: placed.map((s) => ({
      trace: s.trace, x: width / 2 + s.x * radius - REACH / 2, y: height / 2 - s.y * radius - REACH / 2, width: REACH, height: REACH, channel: moment.channel(s.trace),
      label: `${s.trace.label}: elevation ${number(s.elevation, 2)}°, azimuth ${number(s.azimuth)}°, ${s.word}`,
    })),
    words: placed.length ? `${placed.length} in view${out ? `, ${out} out` : ''}` : '',
    sheet: {
      caption: `${placed.length} in view`, head: ['', 'elevation, °', 'azimuth, °', 'health'],
      rows: placed.map((s) => [s.trace.label, s.elevation.toFixed(1), s.azimuth.toFixed(1), s.word]),
    },
  };
}

/** @param {number} elevation @param {number} azimuth degrees */
function place(elevation, azimuth) {
  const r = (90 - elevation) / 90;
  return { x: r * Math.sin((azimuth * Math.PI) / 180), y: r * Math.cos((azimuth * Math.PI) / 180) };
}

/** Where they came from, one line with gaps. @param {Moment} moment @param {Frame} frame */
function tracks(moment, frame) {
  const to = searchAfter(recording.time, moment.time + 1e-9);
  const rows = strided(Math.min(to, searchAfter(recording.time, frame.range[0])), to, TRACK_POINTS);
  /** @type {number[]} */
  const x = [];
  /** @type {number[]} */
  const y = [];
  for (const trace of moment.present()) {
    const elevation = recording.column(trace.signal);
    const azimuth = recording.column(trace.across ?? '');
    if (!elevation || !azimuth || rows.length < 2) continue;
    const points = [...rows].map((row) => place(elevation[row] / moment.factor(trace.signal), azimuth[row] / moment.factor(trace.across ?? '')));
    const [from, end] = [points[0], points[points.length - 1]];
    if (Math.hypot(end.x - from.x, end.y - from.y) < LEAST_TRACK) continue;
    x.push(...points.map((p) => p.x), NaN);
    y.push(...points.map((p) => p.y), NaN);
  }
  return { type: 'scatter', mode: 'lines', x, y, connectgaps: false, line: { color: color('edge'), width: 1 } };
}
