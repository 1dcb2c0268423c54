/** Marks drawn through every chart at once: one layer over the whole column, placed by time alone. */
import { h, keyed } from '../dom.js';
import { clock } from '../format.js';
import { joined } from '../marks.js';
/** @import {Chart, Span, SystemDescription} from '../types' */

const MOST_ALARMS = 16;
const MOST_ISOLATED = 24;

/**
 * @typedef {object} Mark
 * @property {string} key
 * @property {'injected' | 'cleared' | 'alarmed' | 'isolated' | 'readmitted'} kind
 * @property {number} time
 * @property {string} label
 */

/**
 * Lines at the edges of spans.
 * @param {Span[]} spans
 * @param {number} now
 * @param {number} gap seconds that two lines must be apart to be told apart
 * @returns {{bands: Span[], marks: Mark[]}} faults that have begun, and lines
 */
export function drawn(spans, now, gap) {
  /** @param {Span['row']} row */
  const of = (row) => spans.filter((s) => s.row === row);
  const injected = of('injected');
  const alarmed = joined(of('alarmed'), gap * 3);
  const isolated = joined(of('isolated'), gap);
  // Each subject has lines of its own, whoever is out already; too many, and only the first and the last of them count.
  const each = [...Map.groupBy(of('isolated'), (s) => s.key).values()].flatMap((own) => joined(own, gap * 3));
  /** @type {Mark[]} */
  const marks = [];
  /** @param {Span} span @param {Mark['kind']} kind @param {number | null} time @param {string} what */
  const add = (span, kind, time, what) => {
    if (time === null || time > now + 1e-9) return;
    marks.push({ key: `${kind}/${span.key}/${span.index}`, kind, time, label: `${clock(time, 1)} ${what}: ${span.label}` });
  };
  for (const span of injected) {
    add(span, 'injected', span.start, 'fault');
    add(span, 'cleared', span.end, 'fault over');
  }
  // So many lines would hide what they are drawn over; the rail above every chart still has them all.
  if (alarmed.length <= MOST_ALARMS) for (const span of alarmed) add(span, 'alarmed', span.start, 'alarm');
  for (const span of each.length <= MOST_ISOLATED ? each : isolated) {
    add(span, 'isolated', span.start, 'isolated');
    add(span, 'readmitted', span.end, 're-admitted');
  }
  return { bands: injected.filter((s) => s.start <= now), marks };
}

/**
 * Rails of one chart: when something was alarmed or isolated. A chart of tests shows those of its own subjects, and of
 * its own tests.
 * @param {Span[]} spans
 * @param {Chart} chart
 * @param {SystemDescription} description
 * @param {number} gap seconds
 * @returns {Span[]}
 */
export function rails(spans, chart, description, gap) {
  const own = tested(chart, description);
  /** @param {string} subject */
  const concerns = (subject) => !own.length || own.some((t) => t.subject === subject || subject.startsWith(`${t.subject}.`) || t.subject.startsWith(`${subject}.`));
  /** @param {Span} span */
  const shown = (span) => {
    if (span.row === 'isolated') return concerns(span.key);
    const [test, subject] = span.key.split('/');
    return concerns(subject) && (!own.length || own.some((t) => t.test === test));
  };
  /** @param {Span['row']} row @param {number} apart */
  const of = (row, apart) => joined(spans.filter((s) => s.row === row && shown(s)), apart);
  return [...of('alarmed', gap * 3), ...of('isolated', gap)];
}

/** Tests and subjects whose statistics a chart shows; none if it is about something else. @param {Chart} chart @param {SystemDescription} description */
function tested({ traces }, { tests }) {
  return tests.flatMap((test) => test.subjects
    .filter((subject) => traces.some((t) => t.signal.startsWith(`test.${test.name}.${subject}.`)))
    .map((subject) => ({ test: test.name, subject })));
}

/** Lanes of the strips along the top of the layer. */
const seconds = (/** @type {number} */ t) => t.toFixed(4);

/** @param {HTMLElement} layer @param {Span[]} bands @param {Mark[]} marks */
export function drawMarks(layer, bands, marks) {
  const items = [
    ...bands.map((span) => ({ key: `band/${span.row}/${span.key}/${span.index}`, class: `band ${span.row}`, start: span.start, end: span.end })),
    ...marks.map((mark) => ({ key: mark.key, class: `mark ${mark.kind}`, start: mark.time, end: undefined })),
  ];
  keyed(layer, items, (item) => item.key, (item) => h('i', { class: item.class }), (element, item) => {
    const place = `${seconds(item.start)}/${item.end}`;
    if (element.dataset.place === place) return;
    element.dataset.place = place;
    element.style.setProperty('--t', seconds(item.start));
    if (item.end === undefined) return;
    element.style.setProperty('--end', item.end === null ? 'var(--now)' : seconds(item.end));
  });
}

const GLYPHS = { injected: '▼', cleared: '▽', alarmed: '▲', isolated: '■', readmitted: '□' };

/** The same marks as small signs on the time ruler. @param {HTMLElement} ruler @param {Mark[]} marks @param {(time: number) => void} go */
export function drawGlyphs(ruler, marks, go) {
  keyed(ruler, marks, (mark) => mark.key, (mark) => h('button', {
    class: `glyph ${mark.kind}`, title: mark.label, 'aria-label': mark.label, tabindex: -1, style: { '--t': seconds(mark.time) },
    onclick: () => go(mark.time),
  }, GLYPHS[mark.kind]));
}
