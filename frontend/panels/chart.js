/** One chart: title, legend that reads out values and switches lines, the drawing, and the table behind it. */
import { Panel, h, setText, svg } from '../dom.js';
import { Drawing, haunted } from '../charts.js';
import { readout, unitText } from '../format.js';
import { forget, repaint } from '../scheduler.js';
import { recording } from '../session.js';
import { store } from '../store.js';
import { style } from '../traces.js';
/** @import {Chart, SystemDescription, Trace} from '../types' */

/** With more lines than this the legend has rows of its own. */
const MANY = 6;

export class ChartPanel extends Panel {
  visible = false;
  /** @type {{node: HTMLElement, line: HTMLElement, trace: Trace}[]} */
  #values = [];
  /** @type {HTMLElement | null} */
  #legend = null;

  /** @param {Chart} chart @param {SystemDescription} description @param {() => import('../charts.js').Frame} frame */
  constructor(chart, description, frame) {
    super();
    this.chart = chart;
    this.description = description;
    this.frame = frame;
    this.host = h('div', { class: 'plot' });
    this.rail = h('div', { class: 'rail' });
    this.drawing = new Drawing(this.host, chart, description);
  }

  build() {
    if (this.firstChild) return;
    const { chart } = this;
    this.className = `chart ${chart.scale === 'log' ? 'low' : ''} ${chart.traces.length > MANY ? 'many' : ''}`;
    this.setAttribute('role', 'figure');
    this.setAttribute('aria-label', `${chart.title}${unitText(chart.unit) ? `, ${unitText(chart.unit)}` : ''}`);
    this.#legend = h('div', { class: 'legend', role: 'group', 'aria-label': `Lines of ${chart.title}` });
    this.append(
      h('header', {},
        h('h3', {}, chart.title, h('span', { class: 'unit' }, unitText(chart.unit))),
        h('button', { class: 'mini', title: 'Numbers behind this chart', 'aria-label': `Table of ${chart.title}`, onclick: () => this.#table() }, 'table'),
        this.#legend,
      ),
      h('div', { class: 'frame' }, this.rail, this.host),
    );
    this.#drawLegend();
    this.watch((s) => [s.theme, !!s.ghost], () => this.#drawLegend());
    const sight = new IntersectionObserver(([entry]) => {
      this.visible = entry.isIntersecting;
      if (this.visible) repaint([this], true);
    });
    sight.observe(this.host);
    const size = new ResizeObserver(() => repaint([this], true));
    size.observe(this.host);
    this.keep(() => {
      sight.disconnect();
      size.disconnect();
      forget(this);
      this.drawing.erase();
    });
  }

  paint() {
    this.drawing.draw(this.frame());
    this.read();
  }

  /** Writes the values under the cursor into the legend. */
  read() {
    const { hover, cursor, now } = store.get();
    const time = hover ?? cursor ?? now;
    for (const { node, line, trace } of this.#values) {
      line.hidden = this.drawing.empty.has(trace.signal);
      setText(node, readout(recording.at(trace.signal, time) / (this.drawing.factors.get(trace.signal) ?? 1)));
    }
  }

  #drawLegend() {
    this.#values = [];
    const [first] = haunted(this.chart.traces);
    const ghost = store.get().ghost && first ? [this.#ghostKey(style(this.chart, first).color)] : [];
    this.#legend?.replaceChildren(...ghost, ...this.chart.traces.map((trace) => {
      const look = style(this.chart, trace);
      const value = h('span', { class: 'value' });
      const line = h('button', {
        class: 'line', 'aria-pressed': String(!this.drawing.hidden.has(trace.signal)), title: this.#explain(trace),
        onclick: (/** @type {MouseEvent} */ event) => this.#toggle(trace, /** @type {HTMLElement} */ (event.currentTarget)),
      },
        svg('svg', { width: 18, height: 8, 'aria-hidden': 'true' },
          svg('line', { x1: 0, x2: 18, y1: 4, y2: 4, stroke: look.color, 'stroke-width': look.width + 0.5, 'stroke-dasharray': look.dash === 'solid' ? null : look.dash.replaceAll('px', '') })),
        h('span', { class: 'name' }, trace.label, trace.sigma && trace.role !== 'local' && h('small', {}, ' ±3σ')), value);
      this.#values.push({ node: value, line, trace });
      return line;
    }));
    this.read();
  }

  /** @param {string} shade */
  #ghostKey(shade) {
    return h('span', { class: 'line key', title: 'The same run, same noise, without any fault' },
      svg('svg', { width: 18, height: 8, 'aria-hidden': 'true' }, svg('line', { x1: 0, x2: 18, y1: 4, y2: 4, stroke: shade, 'stroke-width': 4, opacity: 0.4 })), 'without the fault');
  }

  /** @param {Trace} trace */
  #explain(trace) {
    const signal = this.description.signals.find((s) => s.name === trace.signal);
    const test = this.description.tests.find((t) => trace.signal.startsWith(`test.${t.name}.`));
    const about = trace.role === 'threshold' && test ? `; alarm when ${test.alarm_when}; ${test.dof}` : '';
    return `${signal?.label ?? trace.signal}${trace.sigma ? ', band: ±3σ' : ''}${about}. Click to hide or show.`;
  }

  /** @param {Trace} trace @param {HTMLElement} button */
  #toggle(trace, button) {
    const { hidden } = this.drawing;
    if (!hidden.delete(trace.signal)) hidden.add(trace.signal);
    button.setAttribute('aria-pressed', String(!hidden.has(trace.signal)));
    repaint([this], true);
  }

  #table() {
    /** @type {import('./table.js').TablePanel | null} */ (document.querySelector('ft-table'))?.open(this.chart, this.frame().range);
  }
}

customElements.define('ft-chart', ChartPanel);
