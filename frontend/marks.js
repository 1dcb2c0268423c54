/**
 * Events to what is drawn through charts and timeline: stretches of time and single points.
 * @import {Event, Experiment, Span, Point, SystemDescription, View} from './types'
 */
import { clock, quantity, number, words, capital } from './format.js';

/**
 * @param {Event[]} events
 * @param {SystemDescription | null} description
 * @returns {{spans: Span[], points: Point[]}}
 */
export function derive(events, description) {
  /** @type {Map<string, Span>} */
  const open = new Map();
  /** @type {Span[]} */
  const spans = [];
  /** @type {Point[]} */
  const points = [];

  /** @param {Span['row']} row @param {string} key @param {string} label @param {Event} event @param {number} start @param {number | null} [end] */
  const begin = (row, key, label, event, start, end = null) => {
    if (open.has(row + key)) return;
    const span = { row, key, label, start, end, index: event.index };
    open.set(row + key, span);
    spans.push(span);
  };
  /** @param {Span['row']} row @param {string} key @param {number} time */
  const finish = (row, key, time) => {
    const span = open.get(row + key);
    if (!span) return;
    span.end = time;
    open.delete(row + key);
  };

  for (const event of events) {
    if (event.run > 0) continue;
    const { kind, subject, detail, time } = event;
    const id = String(detail.id ?? detail.fault ?? subject);
    if (kind === 'fault.injected') begin('injected', id, faultText(detail, description), event, detail.start ?? time, detail.end ?? null);
    else if (kind === 'fault.changed') {
      const span = open.get(`injected${id}`);
      if (span) Object.assign(span, { start: detail.start ?? span.start, end: detail.end ?? null, label: faultText(detail, description) });
    } else if (kind === 'fault.cleared') {
      const span = open.get(`injected${id}`);
      if (span && span.start >= time) spans.splice(spans.indexOf(span), 1);
      finish('injected', id, time);
    } else if (kind === 'test.alarmed') begin('alarmed', `${detail.test}/${subject}`, `${testLabel(String(detail.test), description)}: ${subjectLabel(subject, description)}`, event, time);
    else if (kind === 'test.cleared') finish('alarmed', `${detail.test}/${subject}`, time);
    else if (kind === 'subsystem.isolated') begin('isolated', subject, subjectLabel(subject, description), event, time);
    else if (kind === 'subsystem.readmitted') finish('isolated', subject, time);
    else if (kind === 'subsystem.switched') finish('isolated', subject, time);
    if (isCommand(kind)) points.push({ time, label: sentence(event, description), index: event.index });
  }
  return { spans, points };
}

/** @param {string} kind */
export function isCommand(kind) {
  return ['fault.injected', 'fault.changed', 'fault.cleared', 'subsystem.switched', 'settings.changed'].includes(kind);
}

/**
 * Spans of one row whose gaps are too small to see, joined: at most one line per few pixels is worth drawing.
 * @param {Span[]} spans
 * @param {number} gap seconds
 * @returns {Span[]}
 */
export function joined(spans, gap) {
  /** @type {Span[]} */
  const result = [];
  for (const span of [...spans].sort((a, b) => a.start - b.start)) {
    const last = result.at(-1);
    if (last && (last.end === null || span.start <= last.end + gap)) {
      if (last.end !== null) last.end = span.end === null ? null : Math.max(last.end, span.end);
      if (!last.label.includes(span.label) && last.label.length < 160) last.label += `; ${span.label}`;
    } else result.push({ ...span });
  }
  return result;
}

/** How a person calls a subsystem, a channel, or the one thing in the scene that a sensor is. @param {string} name @param {SystemDescription | null} description @returns {string} */
export function subjectLabel(name, description) {
  const known = description?.subsystems.find((s) => s.name === name) ?? description?.channels.find((c) => c.name === name);
  if (known) return known.label;
  const own = (description?.channels ?? []).filter((c) => c.sensor === name);
  const item = own.length === 1 && description?.scene.find((one) => one.channel === own[0].name);
  return item ? item.label : words(name);
}

/** @param {string} name @param {SystemDescription | null} description */
export function testLabel(name, description) {
  return description?.tests.find((t) => t.name === name)?.label ?? words(name);
}

/**
 * Channels that had no reading in the last epoch, such as a satellite below the horizon.
 * @param {Experiment | null} experiment
 * @returns {Set<string>}
 */
export function unseen(experiment) {
  return new Set(experiment?.not_in_view ?? []);
}

/**
 * Channels that the open experiment has: what is described, less what is not fitted.
 * @param {{description: SystemDescription | null, experiment: Experiment | null}} state
 */
export function fitted({ description, experiment }) {
  return (description?.channels ?? []).filter((c) => !(c.name in (experiment?.unavailable ?? {})));
}

/** @param {string} channel @param {SystemDescription | null} description */
export function channelLabel(channel, description) {
  return description?.channels.find((c) => c.name === channel)?.label ?? channel;
}

/**
 * @param {Record<string, any>} fault
 * @param {SystemDescription | null} description
 */
export function faultText(fault, description) {
  const channel = description?.channels.find((c) => c.name === fault.channel);
  const info = channel?.faults[fault.kind];
  const size = info?.unit === null ? '' : ` ${quantity(fault.magnitude, fault.unit)}`;
  return `${channel?.label ?? fault.channel}: ${info?.label ?? words(String(fault.kind))}${size}`;
}

/** What happened, in a sentence without its numbers. @param {Event} event @param {SystemDescription | null} description */
export function sentence(event, description) {
  const { kind, subject, detail } = event;
  const who = subjectLabel(subject, description);
  switch (kind) {
    case 'fault.injected':
      return `Injected ${faultText(detail, description)}${detail.start > event.time ? `, armed for ${clock(detail.start, 1)}` : ''}`;
    case 'fault.started':
      return `Fault begins: ${faultText(detail, description)}`;
    case 'fault.ended':
      return `Fault ends: ${faultText(detail, description)}`;
    case 'fault.acted':
      return `Fault acts: ${faultText(detail, description)}`;
    case 'fault.silent':
      return `Fault never acted: ${faultText(detail, description)}`;
    case 'fault.changed':
      return `Changed to ${faultText(detail, description)}`;
    case 'fault.cleared':
      return `Cleared ${faultText(detail, description)}`;
    case 'test.alarmed':
      return `${testLabel(String(detail.test), description)} alarms on ${who}`;
    case 'test.cleared':
      return `${testLabel(String(detail.test), description)} is quiet again on ${who}`;
    case 'subsystem.isolated':
      return `${who} isolated`;
    case 'subsystem.suspected':
      return `${who} suspected`;
    case 'subsystem.readmitted':
      return `${who} re-admitted`;
    case 'subsystem.switched':
      return `${who} switched ${detail.enabled ? 'on' : 'off'}`;
    case 'settings.changed':
      return `Settings: ${Object.entries(detail).map(([key, value]) => `${words(key)} ${value}`).join(', ')}`;
    default:
      if (typeof detail.text === 'string') return capital(detail.text);
      return `${capital(words(kind))}: ${who}`;
  }
}

/** The numbers that caused it. @param {Event} event @param {SystemDescription | null} description @returns {string} */
export function reason(event, description) {
  const { kind, detail } = event;
  if (kind === 'fault.silent') return String(detail.because ?? '');
  if (kind.startsWith('fault.') || kind === 'settings.changed' || kind === 'subsystem.switched') return '';
  if (typeof detail.text === 'string') return '';  // its numbers are in the sentence
  if (Array.isArray(detail.alarms)) {
    const all = detail.alarms.map((alarm) => comparison(alarm, description, true, true)).join('; ');
    // What alarmed until then is not what admitted it.
    return kind === 'subsystem.readmitted' && all ? `tests until then: ${all}` : all;
  }
  if ('statistic' in detail) return comparison(detail, description, false, kind === 'test.alarmed');
  return Object.entries(detail)
    .filter(([, value]) => typeof value !== 'object')
    .map(([key, value]) => `${words(key)} ${typeof value === 'number' ? number(value) : value}`)
    .join(', ');
}

/** Less than this is nothing, in a number without a unit. */
const NOTHING = 1e-4;

/** @param {Record<string, any>} alarm @param {SystemDescription | null} description @param {boolean} named @param {boolean} alarmed */
function comparison(alarm, description, named, alarmed) {
  if (alarm.statistic === null || alarm.threshold === null) return named ? `${testLabel(String(alarm.test), description)} without a reading` : 'no reading';
  const test = description?.tests.find((t) => t.name === alarm.test);
  // What is told in a unit is no chi-square statistic, and has no degrees of freedom.
  const unit = test && test.unit !== '1' ? test.unit : '';
  const signal = unit && description?.signals.find((s) => s.name.startsWith(`test.${alarm.test}.`) && s.name.endsWith('.statistic'));
  const factor = signal ? signal.factor : 1;
  const dof = alarm.dof && !unit ? ` (${number(alarm.dof)} dof)` : '';
  const name = named ? `${testLabel(String(alarm.test), description)} ` : '';
  /** @param {number} value */
  const told = (value) => quantity(!unit && Math.abs(value) < NOTHING ? 0 : value / factor, unit);
  const [value, limit] = [told(alarm.statistic), told(alarm.threshold)];
  const small = test?.alarm_when === 'below';
  const asked = small && !alarmed && alarm.statistic <= alarm.threshold ? ', no longer asked' : '';
  return `${name}${value} ${relation(alarm, value === limit, alarmed, small)} ${limit}${dof}${asked}`;
}

/**
 * How a statistic stands to its threshold. That it is small is what alarms in some tests: then it is said in words.
 * @param {Record<string, any>} alarm
 * @param {boolean} alike whether both read the same
 * @param {boolean} alarmed
 * @param {boolean} small whether the test alarms when it is small
 */
function relation({ statistic, threshold }, alike, alarmed, small) {
  const below = statistic <= threshold;
  if (alike) return below ? 'just below' : 'just above';
  if (below && alarmed) return 'below';
  if (small) return below ? 'below' : 'above';
  return below ? '<' : '>';
}
