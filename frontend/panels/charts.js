/** The column of charts on one time axis: marks, crosshair and zoom are shared by all of them. */
import { Panel, fill, h, keyed, setText } from '../dom.js';
import { MARGIN, loadPlotly } from '../charts.js';
import { clock, decimalsOf, labelledTicks } from '../format.js';
import { derive, joined } from '../marks.js';
import { repaint } from '../scheduler.js';
import { recorded } from '../session.js';
import { period, store } from '../store.js';
import { forgetColors } from '../traces.js';
import { look, say, toggleGhost, zoomTo } from '../actions.js';
import { ChartPanel } from './chart.js';
import { MomentPanel } from './moment.js';
import { chooser } from './chooser.js';
import { drawGlyphs, drawMarks, drawn, rails } from './overlay.js';

/** Parts of the column that do not lie on the time axis. */
const APART = 'header, .moment';
const FOLLOWED = [5, 10, 30, 60, 300, 600];

export class ChartsPanel extends Panel {
  /** @type {(ChartPanel | MomentPanel)[]} */
  #charts = [];
  /** Those over the common time axis. @type {ChartPanel[]} */
  #lines = [];
  /** Those of one moment. @type {MomentPanel[]} */
  #moments = [];
  /** @type {import('../types').Span[]} */
  #spans = [];
  /** @type {number | null} */
  #dragFrom = null;

  build() {
    this.stack = h('div', { class: 'stack' });
    this.marks = h('div', { class: 'marks', 'aria-hidden': 'true' });
    this.hoverLine = h('i', { class: 'hover-line', hidden: true });
    this.cursorLine = h('i', { class: 'cursor-line', hidden: true });
    this.nowLine = h('i', { class: 'now-line' });
    this.selection = h('i', { class: 'selection', hidden: true });
    this.layer = h('div', { class: 'layer' }, this.marks, this.nowLine, this.hoverLine, this.cursorLine, this.selection);
    this.glyphs = h('div', { class: 'glyphs' });
    this.ticks = h('div', { class: 'ticks' });
    this.hoverTime = h('span', { class: 'hover-time', hidden: true });
    this.ruler = h('div', { class: 'ruler' }, this.ticks, this.glyphs, this.hoverTime);
    this.scroller = h('div', { class: 'scroller', tabindex: 0, role: 'region', 'aria-label': 'Charts' },
      h('div', { class: 'column' }, this.stack, this.layer), h('p', { class: 'empty' }, 'No chart is shown. Choose some above.'));
    this.append(this.#toolbar(), this.scroller, this.ruler);
    this.#listen();
    const size = new ResizeObserver(() => this.#drawTicks(...this.range()));
    size.observe(this.ruler);
    this.keep(() => size.disconnect());
    this.watch((s) => [s.description, s.shown], () => this.#place());
    this.watch((s) => s.experiment?.id, () => { if (this.scroller) this.scroller.scrollTop = 0; });
    this.watch((s) => [s.zoom, s.follow, s.experiment?.clock.duration], () => this.#rescale(true));
    this.watch((s) => s.now, () => (store.get().follow && !store.get().zoom ? this.#rescale(false) : this.#moveNow()));
    this.watch((s) => [s.events, s.description, s.zoom, s.now > 0], () => this.#drawMarks());
    this.watch((s) => s.hover, () => this.#drawHover());
    this.watch((s) => s.cursor, (cursor) => {
      this.#line(this.cursorLine, cursor);
      this.#read();
      repaint(this.#moments, true);
    });
    this.watch((s) => [s.pastView ?? s.view], () => repaint(this.#moments, store.get().cursor !== null));
    this.watch((s) => s.theme, () => {
      forgetColors();
      repaint(this.#charts, true);
    });
    this.watch((s) => s.experiment?.clock.state, (state) => repaint(this.#charts, state !== 'running'));
    const redraw = () => {
      repaint(this.#charts);
      if (store.get().experiment?.clock.state !== 'running') for (const one of this.#lines) if (!one.visible) one.refresh();
    };
    recorded.addEventListener('change', redraw);
    this.keep(() => recorded.removeEventListener('change', redraw));
    this.watch((s) => !!s.experiment, (arrived) => {
      if (arrived) loadPlotly().then(() => repaint(this.#charts, true), (error) => say({ tone: 'error', text: error.message }));
    });
  }

  #toolbar() {
    const follow = h('select', {
      'aria-label': 'Time window of the charts',
      onchange: () => store.set({ follow: Number(follow.value) || null, zoom: null }),
    });
    const unzoom = h('button', { class: 'mini', hidden: true, title: 'Show the whole window again (0)', onclick: () => zoomTo(null) }, 'Reset zoom');
    const ghost = h('button', { class: 'mini', 'aria-pressed': 'false', title: 'Draw the same run without any fault behind this one (g)', onclick: toggleGhost }, 'Run without the fault');
    this.watch((s) => s.experiment?.clock.duration ?? 0, (duration) => {
      fill(follow, h('option', { value: '' }, 'whole flight'),
        ...FOLLOWED.filter((n) => n < duration * 0.7).map((n) => h('option', { value: n }, `last ${n < 60 ? `${n} s` : `${n / 60} min`}`)));
      store.set({ follow: null });
    });
    this.watch((s) => s.zoom, (zoom) => { unzoom.hidden = !zoom; });
    this.watch((s) => s.ghost, (one) => ghost.setAttribute('aria-pressed', String(!!one)));
    return h('div', { class: 'toolbar' }, chooser(this), h('label', { class: 'inline' }, 'Window', follow), unzoom, ghost,
      h('span', { class: 'key' },
        h('span', { class: 'fault-key' }, '▼ fault'), h('span', { class: 'alarm-key' }, '▲ alarm'), h('span', { class: 'isolated-key' }, '■ isolated')));
  }

  #place() {
    const { description, shown } = store.get();
    const charts = (description?.charts ?? []).filter((c) => shown.includes(c.id));
    keyed(this.stack ?? this, charts, (c) => `${description?.id}/${c.id}`, (chart) => {
      if (!description) throw new Error('no description');
      return new (chart.kind === 'time' ? ChartPanel : MomentPanel)(chart, description, () => this.#frame());
    });
    this.#charts = /** @type {(ChartPanel | MomentPanel)[]} */ ([...(this.stack?.children ?? [])]);
    this.#lines = this.#charts.filter((c) => c instanceof ChartPanel);
    this.#moments = this.#charts.filter((c) => c instanceof MomentPanel);
    this.classList.toggle('none', !charts.length && !!description);
    this.#drawRails();
  }

  /** @returns {import('../charts.js').Frame} */
  #frame() {
    const { experiment, ghost } = store.get();
    return { range: this.range(), live: experiment?.clock.state === 'running', ghost: !!ghost };
  }

  /** What the shared time axis spans [s]. @returns {[number, number]} */
  range() {
    const { zoom, follow, now, experiment } = store.get();
    const duration = experiment?.clock.duration ?? 100;
    if (zoom) return zoom;
    if (follow) return [Math.max(0, now - follow), Math.max(follow, now)];
    return [0, duration];
  }

  /** @param {boolean} person */
  #rescale(person) {
    const [from, to] = this.range();
    this.scroller?.style.setProperty('--from', String(from));
    this.scroller?.style.setProperty('--span', String(to - from));
    this.ruler?.style.setProperty('--from', String(from));
    this.ruler?.style.setProperty('--span', String(to - from));
    this.#drawTicks(from, to);
    this.#moveNow();
    this.#line(this.cursorLine, store.get().cursor);
    this.#drawHover();
    if (person) repaint(this.#charts, true);
  }

  /** @param {number} from @param {number} to */
  #drawTicks(from, to) {
    const ticks = labelledTicks(from, to, this.ruler?.clientWidth || 600, 10);
    keyed(this.ticks ?? this, ticks, ({ at }) => at.toFixed(3), ({ at }) => h('span', { style: { '--t': at.toFixed(4) } }), (element, { text, end }) => {
      setText(element, text);
      element.classList.toggle('end', end);
    });
  }

  #moveNow() {
    const { now } = store.get();
    this.marks?.style.setProperty('--now', String(now));
    for (const chart of this.#lines) if (chart.visible) chart.rail.style.setProperty('--now', String(now));
    this.#line(this.nowLine, store.get().now);
  }

  #drawMarks() {
    if (!this.marks || !this.glyphs) return;
    const { events, description, now } = store.get();
    const [from, to] = this.range();
    this.#spans = derive(events, description).spans;
    const { bands, marks } = drawn(this.#spans, now, (to - from) / 400);
    // Washes of faults that are live together would add up and drown the lines.
    drawMarks(this.marks, joined(bands, 0), marks);
    this.#drawRails();
    drawGlyphs(this.glyphs, marks, look);
  }

  /** When something was alarmed or isolated: a rail along the top of every chart that it concerns. */
  #drawRails() {
    const [from, to] = this.range();
    for (const one of this.#lines) drawMarks(one.rail, rails(this.#spans, one.chart, one.description, (to - from) / 400), []);
  }

  #drawHover() {
    const { hover } = store.get();
    this.#line(this.hoverLine, hover);
    if (!this.hoverTime) return;
    this.hoverTime.hidden = hover === null;
    if (hover !== null) {
      this.hoverTime.style.setProperty('--t', String(hover));
      setText(this.hoverTime, clock(hover, Math.max(1, decimalsOf(period()))));
    }
    this.#read();
  }

  #read() {
    for (const chart of this.#lines) if (chart.visible) chart.read();
  }

  /** @param {HTMLElement | undefined} line @param {number | null} time */
  #line(line, time) {
    if (!line) return;
    const [from, to] = this.range();
    line.hidden = time === null || time < from || time > to;
    if (time !== null) line.style.setProperty('--t', String(time));
  }

  #listen() {
    const column = this.stack;
    if (!column) return;
    column.addEventListener('pointermove', (event) => {
      const time = this.#timeAt(event);
      store.set({ hover: time });
      if (this.#dragFrom !== null && time !== null && this.selection) {
        this.selection.hidden = Math.abs(time - this.#dragFrom) < this.#pixel() * 4;
        this.selection.style.setProperty('--t', String(Math.min(time, this.#dragFrom)));
        this.selection.style.setProperty('--end', String(Math.max(time, this.#dragFrom)));
      }
    });
    column.addEventListener('pointerleave', () => store.set({ hover: null }));
    column.addEventListener('pointerdown', (event) => {
      if (event.button !== 0 || !(event.target instanceof Element) || event.target.closest(APART)) return;
      this.#dragFrom = this.#timeAt(event);
      column.setPointerCapture(event.pointerId);
    });
    column.addEventListener('pointerup', (event) => {
      const from = this.#dragFrom;
      this.#dragFrom = null;
      if (this.selection) this.selection.hidden = true;
      const to = this.#timeAt(event);
      if (from === null || to === null) return;
      if (Math.abs(to - from) >= this.#pixel() * 4) zoomTo([Math.min(from, to), Math.max(from, to)]);
      else look(to);
    });
    column.addEventListener('dblclick', (event) => {
      if (event.target instanceof Element && event.target.closest(APART)) return;
      zoomTo(null);
      look(null);
    });
    column.addEventListener('wheel', (event) => {
      const time = this.#timeAt(event);
      if (!event.ctrlKey || time === null) return;
      event.preventDefault();
      const [from, to] = this.range();
      const scale = event.deltaY > 0 ? 1.25 : 0.8;
      const { experiment } = store.get();
      const wider = /** @type {[number, number]} */ ([time - (time - from) * scale, time + (to - time) * scale]);
      zoomTo(wider[1] - wider[0] >= (experiment?.clock.duration ?? 0) ? null : wider);
    }, { passive: false });
  }

  /** @param {MouseEvent} event */
  #timeAt(event) {
    if (!this.layer || (event.target instanceof Element && event.target.closest(APART) && this.#dragFrom === null)) return null;
    const box = this.layer.getBoundingClientRect();
    const share = (event.clientX - box.left) / box.width;
    const [from, to] = this.range();
    if (this.#dragFrom === null && (share < -0.01 || share > 1.01)) return null;
    return from + Math.min(1, Math.max(0, share)) * (to - from);
  }

  /** Seconds a pixel is wide. */
  #pixel() {
    const [from, to] = this.range();
    return (to - from) / Math.max(1, this.layer?.clientWidth ?? 1);
  }
}

document.documentElement.style.setProperty('--plot-left', `${MARGIN.left}px`);
document.documentElement.style.setProperty('--plot-right', `${MARGIN.right}px`);
customElements.define('ft-charts', ChartsPanel);
