/** One chart: title, legend that reads out values and switches lines, the drawing, and the table behind it. */
import { Panel, h, setText, svg } from '../dom.js';
import { Drawing, haunted } from '../charts.js';
import { number, places, readout, unitText } from '../format.js';
import { forget, repaint } from '../scheduler.js';
import { recording } from '../session.js';
import { store } from '../store.js';
import { color } from '../traces.js';
/** @import {Chart, SystemDescription, Trace} from '../types' */

/** With more lines than this the legend has rows of its own. */
const ROOMY = 4;

/**
 * Draws a panel only while it can be seen, and again when it changes size.
 * @param {Panel & {visible: boolean, paint: () => void}} panel
 * @param {HTMLElement} host
 * @param {() => void} gone
 */
export function seen(panel, host, gone) {
  const sight = new IntersectionObserver(([entry]) => {
    panel.visible = entry.isIntersecting;
    if (panel.visible) repaint([panel], true);
  });
  // Title and legend count: they are seen before the drawing is.
  sight.observe(panel);
  const size = new ResizeObserver(() => repaint([panel], true));
  size.observe(host);
  panel.keep(() => {
    sight.disconnect();
    size.disconnect();
    forget(panel);
    gone();
  });
}

export class ChartPanel extends Panel {
  visible = false;
  /** @type {{node: HTMLElement, trace: Trace}[]} */
  #values = [];
  /** @type {HTMLElement | null} */
  #legend = null;
  /** Greatest value told so far, which sets the decimals: they do not dance. */
  #most = 0;

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
    this.className = `chart ${chart.scale === 'log' ? 'low' : ''} ${chart.traces.length > ROOMY ? 'many' : ''}`;
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
    seen(this, this.host, () => this.drawing.erase());
  }

  paint() {
    this.drawing.draw(this.frame());
    this.refresh();
  }

  /** Which lines there are, and their values: also of a chart that is out of sight, so that it is never of another run. */
  refresh() {
    this.classList.toggle('blank', recording.length > 0 && !this.drawing.present().length);
    if (this.drawing.present().length !== this.#values.length) this.#drawLegend();
    else this.read();
  }

  /** Writes the values under the cursor into the legend: all of a chart with the same decimals, or the same digits. */
  read() {
    const { hover, cursor, now } = store.get();
    const time = hover ?? cursor ?? now;
    const { levels, scale } = this.chart;
    const values = this.#values.map(({ trace }) => recording.at(trace.signal, time) / (this.drawing.factors.get(trace.signal) ?? 1));
    const counts = this.chart.unit === '1' && values.every((v) => Number.isNaN(v) || Number.isInteger(v));
    values.forEach((value, i) => {
      if (this.#values[i].trace.role !== 'threshold' && Number.isFinite(value)) this.#most = Math.max(this.#most, Math.abs(value));
    });
    const decimals = scale === 'log' ? null : places(this.#most);
    this.#values.forEach(({ node, trace }, i) => {
      const away = this.drawing.beyond.has(trace.signal) ? ' ↑' : '';
      if (!!away !== node.title.length > 0) node.title = away && 'so far away that it is not drawn';
      setText(node, levels.length ? (levels[values[i]] ?? '–') : counts ? number(values[i], 6) : readout(values[i], decimals) + away);
    });
  }

  #drawLegend() {
    this.#values = [];
    this.#most = 0;
    const [first] = haunted(this.chart.traces);
    const ghost = store.get().ghost && first ? [this.#ghostKey(this.drawing.style(first).color)] : [];
    this.#legend?.replaceChildren(...ghost, ...this.drawing.present().map((trace) => {
      const look = this.drawing.style(trace);
      const value = h('span', { class: 'value' });
      const line = h('button', {
        class: 'line', 'aria-pressed': String(!this.drawing.hidden.has(trace.signal)), title: this.#explain(trace),
        onclick: (/** @type {MouseEvent} */ event) => this.#toggle(trace, /** @type {HTMLElement} */ (event.currentTarget)),
      },
        this.chart.stacked ? area(look) : stroke(look),
        h('span', { class: 'name' }, trace.label, trace.sigma && trace.role !== 'local' && h('small', {}, ' ±3σ')), value);
      this.#values.push({ node: value, trace });
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
    const about = trace.role === 'threshold' && test ? `; alarm when ${test.alarm_when}; ${test.dof}; false-alarm probability ${test.probability}${test.probability_note && `: ${test.probability_note}`}` : '';
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

/** @param {import('../traces.js').Style} look */
function stroke(look) {
  return svg('svg', { width: 18, height: 8, 'aria-hidden': 'true' },
    svg('line', { x1: 0, x2: 18, y1: 4, y2: 4, stroke: look.color, 'stroke-width': look.width + 0.5, 'stroke-dasharray': look.dash === 'solid' ? null : look.dash.replaceAll('px', '') }));
}

/** As the area is drawn: a fill, and a hatch where the colour comes a second time. @param {import('../traces.js').Style} look */
function area(look) {
  const hatched = look.dash !== 'solid';
  return svg('svg', { width: 18, height: 10, class: `area ${hatched ? 'hatched' : ''}`, 'aria-hidden': 'true' },
    svg('rect', { width: 18, height: 10, fill: look.color, opacity: 0.6 }),
    hatched && svg('path', { d: 'M-2 10L8 0M5 10L15 0M12 10L22 0', stroke: color('panel'), 'stroke-width': 2.2 }));
}

customElements.define('ft-chart', ChartPanel);
