/** The whole flight on one line: what was broken, who noticed, what was done; dragging the playhead looks back. */
import { Panel, h, keyed, setText } from '../dom.js';
import { clock, decimalsOf, labelledTicks } from '../format.js';
import { derive, joined } from '../marks.js';
import { period, store } from '../store.js';
import { branch, look, rewind } from '../actions.js';
/** @import {Span} from '../types' */

/** @type {[Span['row'], string][]} */
const ROWS = [['injected', 'Injected'], ['alarmed', 'Alarmed'], ['isolated', 'Isolated']];
const LANES = 4;

export class Timeline extends Panel {
  build() {
    this.rows = Object.fromEntries([...ROWS.map(([row]) => row), 'commands'].map((row) => [row, h('div', { class: `lane ${row}` })]));
    this.ticks = h('div', { class: 'ticks', 'aria-hidden': 'true' });
    this.knob = h('span', { class: 'knob' });
    this.head = h('div', { class: 'head', role: 'slider', tabindex: 0, 'aria-label': 'Playhead', 'aria-valuemin': 0, 'aria-orientation': 'horizontal' }, this.knob);
    this.nowMark = h('i', { class: 'now' });
    this.track = h('div', { class: 'track' }, ...Object.values(this.rows), this.ticks, this.nowMark, this.head);
    this.bar = h('div', { class: 'past', hidden: true });
    this.append(
      h('div', { class: 'names', 'aria-hidden': 'true' }, ...ROWS.map(([, name]) => h('span', {}, name)), h('span', {}, 'Commands')),
      this.track, this.bar);
    this.#listen();
    this.#past();
    const size = new ResizeObserver(() => this.#drawTicks(store.get().experiment?.clock.duration ?? 100));
    size.observe(this.track);
    this.keep(() => size.disconnect());
    this.watch((s) => s.experiment?.clock.duration ?? 100, (duration) => {
      this.track?.style.setProperty('--span', String(duration));
      this.head?.setAttribute('aria-valuemax', String(duration));
      this.#drawTicks(duration);
      this.#draw();
    });
    this.watch((s) => [s.events, s.description, s.experiment?.faults, s.experiment?.id], () => this.#draw());
    this.watch((s) => [s.now, s.cursor], () => this.#move());
  }

  #past() {
    const at = h('b', {});
    const live = h('button', { onclick: () => look(null), 'aria-label': 'Back to live', title: 'Back to live (Esc)' }, h('span', { class: 'wordy' }, 'Back to '), 'live');
    this.bar?.append(h('span', {}, 'Looking at ', at), h('button', { 'aria-label': 'Rewind to here', title: 'Forget what came later and go on from here (r)', onclick: () => this.#at(rewind) }, 'Rewind', h('span', { class: 'wordy' }, ' to here')),
      h('button', { 'data-once': true, 'aria-label': 'Branch from here', title: 'Keep this run, and go on from here in a copy (b)', onclick: () => this.#at(branch) }, 'Branch', h('span', { class: 'wordy' }, ' from here')), live);
    this.watch((s) => s.cursor, (cursor) => {
      if (!this.bar) return;
      this.bar.hidden = cursor === null;
      if (cursor !== null) setText(at, clock(cursor, this.#decimals()));
    });
  }

  /** @param {(time: number) => unknown} act */
  #at(act) {
    const { cursor } = store.get();
    if (cursor !== null) act(cursor);
  }

  #decimals() {
    return Math.max(1, decimalsOf(period()));
  }

  /** @param {number} duration */
  #drawTicks(duration) {
    if (!this.ticks) return;
    const ticks = labelledTicks(0, duration, this.ticks.clientWidth || 600, 12);
    keyed(this.ticks, ticks, ({ at }) => `${at}`, ({ at }) => h('span', { style: { '--t': at } }), (element, { text, end }) => {
      setText(element, text);
      element.classList.toggle('end', end);
    });
  }

  #draw() {
    const { events, description, experiment } = store.get();
    const duration = experiment?.clock.duration ?? 100;
    const { spans, points } = derive(events, description);
    for (const [row] of ROWS) {
      const own = spans.filter((s) => s.row === row);
      const merged = row === 'injected' ? own : [...Map.groupBy(own, (s) => s.key.split('/').at(-1)).values()].flatMap((group) => joined(group, duration / 400));
      this.#lane(row, lanes(merged));
    }
    keyed(this.rows?.commands ?? this, points, (p) => `${p.index}`, (point) => h('button', {
      class: 'dot', tabindex: -1, title: `${clock(point.time, 1)} ${point.label}`, 'aria-label': `${clock(point.time, 1)} ${point.label}`,
      style: { '--t': point.time }, onclick: () => look(point.time),
    }));
  }

  /** @param {string} row @param {{span: Span, lane: number, of: number}[]} placed */
  #lane(row, placed) {
    keyed(this.rows?.[row] ?? this, placed, ({ span }) => `${span.key}/${span.index}`, ({ span }) => h('button', { class: 'span', tabindex: -1, onclick: () => look(Number(span.start)) }),
      (element, { span, lane, of }) => {
        const style = `--t:${span.start};--end:${span.end ?? 'var(--open)'};--lane:${lane};--lanes:${of}`;
        if (element.dataset.style !== style) {
          element.dataset.style = style;
          element.style.cssText = style;
          const until = span.end === null ? 'still' : `to ${clock(span.end, 1)}`;
          element.title = `${span.label}: ${clock(span.start, 1)} ${until}`;
          element.setAttribute('aria-label', element.title);
        }
        element.classList.toggle('armed', span.start > store.get().now);
      });
  }

  #move() {
    const { now, cursor } = store.get();
    const at = cursor ?? now;
    this.track?.style.setProperty('--now', String(now));
    this.head?.style.setProperty('--t', String(at));
    this.head?.classList.toggle('looking', cursor !== null);
    if (this.knob) setText(this.knob, clock(at, at < 600 && this.#decimals() < 2 ? 1 : this.#decimals()));
    this.head?.setAttribute('aria-valuenow', at.toFixed(3));
    this.head?.setAttribute('aria-valuetext', `${clock(at, this.#decimals())}${cursor === null ? ', live' : ''}`);
  }

  #listen() {
    const track = this.track;
    if (!track || !this.head) return;
    /** @param {PointerEvent} event */
    const go = (event) => {
      const box = track.getBoundingClientRect();
      const share = Math.min(1, Math.max(0, (event.clientX - box.left) / box.width));
      look(share * (store.get().experiment?.clock.duration ?? 0));
    };
    let dragging = false;
    track.addEventListener('pointerdown', (event) => {
      if (event.button !== 0 || (event.target instanceof Element && event.target.closest('.dot'))) return;
      dragging = true;
      track.setPointerCapture(event.pointerId);
      go(event);
    });
    track.addEventListener('pointermove', (event) => dragging && go(event));
    track.addEventListener('pointerup', () => { dragging = false; });
    this.head.addEventListener('keydown', (event) => {
      const { now, cursor, experiment } = store.get();
      const at = cursor ?? now;
      const far = (experiment?.clock.duration ?? 0) / 20;
      const to = { ArrowLeft: at - period(), ArrowRight: at + period(), PageDown: at - far, PageUp: at + far, Home: 0, End: Infinity }[event.key];
      if (to === undefined) return;
      event.preventDefault();
      event.stopPropagation();
      look(to);
    });
  }
}

/** Spans that overlap lie in lanes of their own, a few at most. @param {Span[]} spans */
function lanes(spans) {
  /** @type {number[]} */
  const free = [];
  const placed = [...spans].sort((a, b) => a.start - b.start).map((span) => {
    let lane = free.findIndex((until) => until <= span.start);
    if (lane < 0) lane = free.length < LANES ? free.push(0) - 1 : LANES - 1;
    free[lane] = Math.max(free[lane], span.end ?? Infinity);
    return { span, lane, of: 0 };
  });
  for (const one of placed) one.of = free.length;
  return placed;
}

customElements.define('ft-timeline', Timeline);
