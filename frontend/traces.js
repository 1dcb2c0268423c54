/**
 * How a line looks: by its role, then by its place among its peers. Vermilion, yellow and purple are kept for faults,
 * alarms and isolation; a dash tells lines apart where colour does not.
 * @import {Chart, Trace} from './types'
 */

/** @typedef {{color: string, width: number, dash: string, opacity: number}} Style */

const DASHES = ['solid', '5px,2px', '2px,2px', '8px,3px,2px,3px'];

/** Dashes of thresholds and limits. */
const LIMITS = ['7px,4px', '2px,5px', '12px,3px,2px,3px'];

/** @type {Map<string, string>} */
const colors = new Map();

/** A colour of the theme by the name of its custom property. @param {string} name */
export function color(name) {
  let value = colors.get(name);
  if (value === undefined) {
    value = getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
    colors.set(name, value);
  }
  return value;
}

export function forgetColors() {
  colors.clear();
}

const SERIES = ['series-1', 'series-2', 'series-3', 'series-4', 'series-5'];

/** Signals that a chart is drawn from. @param {Chart} chart @returns {string[]} */
export function signalsOf(chart) {
  const names = chart.traces.flatMap((t) => [t.signal, t.sigma, t.across, t.code]);
  return [...new Set([...names, chart.limit])].filter((name) => typeof name === 'string');
}

/** @param {string} hex `#rrggbb` @param {number} opacity */
export function tint(hex, opacity) {
  const value = Number.parseInt(hex.slice(1), 16);
  return `rgba(${value >> 16},${(value >> 8) & 255},${value & 255},${opacity})`;
}

/** Roles with a style of their own; all others share one row of colours. @type {string[]} */
const APART = ['protected', 'local', 'unprotected', 'threshold'];

/** Traces that are told apart by their place alone. @param {Chart} chart @param {Trace} trace */
const peers = (chart, trace) => chart.traces.filter((t) => (APART.includes(trace.role) ? t.role === trace.role : !APART.includes(t.role)));

/** @param {Chart} chart @param {Trace} trace @param {number} [place] among its peers, where it is not the declared one @returns {Style} */
export function style(chart, trace, place = peers(chart, trace).indexOf(trace)) {
  const protectedOnes = chart.traces.filter((t) => t.role === 'protected').length;
  const locals = chart.traces.filter((t) => t.role === 'local').length;
  // The protected and the local ones have the first colours; what stands beside them begins after those, and is dashed.
  const after = APART.includes(trace.role) ? 0 : protectedOnes + locals;
  const shade = SERIES[(place + after) % SERIES.length];
  const dash = DASHES[(Math.floor((place + after) / SERIES.length) + (after ? 1 + (place % 2) : 0)) % DASHES.length];
  switch (trace.role) {
    case 'protected':
      return { color: color(shade), width: 1.6, dash: DASHES[place % DASHES.length], opacity: 1 };
    case 'local': {
      const own = (protectedOnes || 1) + place;
      return { color: color(SERIES[own % SERIES.length]), width: 1.1, dash: DASHES[1 + (place % 3)], opacity: 1 };
    }
    case 'unprotected':
      return { color: color('dim'), width: 1.2, dash: '2px,2px', opacity: 1 };
    case 'threshold':
      return { color: color('ink'), width: 1, dash: LIMITS[place % LIMITS.length], opacity: 0.75 };
    default:
      return { color: color(shade), width: 1.2, dash, opacity: 1 };
  }
}
