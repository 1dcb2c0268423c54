/** A chart of one moment: the picture, what it comes to in words, and what can be pointed at, by mouse or by keys. */
import { Panel, h, keyed, setText } from '../dom.js';
import { unitText } from '../format.js';
import { Moment } from '../moments.js';
import { repaint } from '../scheduler.js';
import { seen } from './chart.js';
import { signalsOf } from '../traces.js';
import { chooseChannel } from '../actions.js';
/** @import {Chart, SystemDescription} from '../types' */
/** @import {Frame, Picture, Target} from '../moments' */

export class MomentPanel extends Panel {
  visible = false;
  /** @type {Picture | null} */
  #picture = null;
  /** What had the keys last. */
  #current = '';

  /** @param {Chart} chart @param {SystemDescription} description @param {() => Frame} frame */
  constructor(chart, description, frame) {
    super();
    this.chart = chart;
    this.frame = frame;
    this.host = h('div', { class: 'plot', title: chart.regions.map((r) => r.meaning && `${r.label}: ${r.meaning}`).filter(Boolean).join('\n') || null });
    this.targets = h('div', { class: 'targets', role: 'group', 'aria-label': `What ${chart.title} shows` });
    this.words = h('p', { class: 'words' });
    this.drawing = new Moment(this.host, chart, description);
  }

  build() {
    if (this.firstChild) return;
    const { chart } = this;
    const unit = chart.kind === 'bars' ? unitText(chart.unit) : '';
    this.className = `chart moment ${chart.kind}`;
    this.setAttribute('role', 'figure');
    this.setAttribute('aria-label', `${chart.title}${unit ? `, ${unit}` : ''}`);
    this.append(
      h('header', {},
        h('h3', {}, chart.title, h('span', { class: 'unit' }, unit)),
        h('button', { class: 'mini', title: 'Numbers behind this chart', 'aria-label': `Table of ${chart.title}`, onclick: () => this.#table() }, 'table')),
      h('div', { class: 'frame' }, this.host, this.targets), this.words);
    this.targets.addEventListener('keydown', (event) => this.#walk(event));
    seen(this, this.host, () => this.drawing.erase());
    repaint([this]);
  }

  paint() {
    const picture = this.drawing.draw(this.frame());
    if (!picture) return;
    this.#picture = picture;
    setText(this.words, picture.words);
    this.words.title = picture.words;
    const active = picture.targets.find((t) => t.trace.signal === this.#current) ?? picture.targets[0];
    keyed(this.targets, picture.targets, (t) => t.trace.signal, (target) => this.#target(target), (element, t) => {
      const place = `left:${t.x.toFixed(1)}px;top:${t.y.toFixed(1)}px;width:${t.width.toFixed(1)}px;height:${t.height.toFixed(1)}px`;
      if (element.dataset.place !== place) {
        element.dataset.place = place;
        element.style.cssText = place;
      }
      const says = t.channel ? `${t.label}. Click to choose its channel.` : t.label;
      if (element.title !== says) {
        element.title = says;
        element.setAttribute('aria-label', t.channel ? `${t.label}. Choose its channel` : t.label);
      }
      element.tabIndex = t === active ? 0 : -1;
    });
  }

  /** @param {Target} target */
  #target(target) {
    const { signal } = target.trace;
    return h('button', {
      class: 'target', 'data-item': target.trace.item,
      onfocus: () => { this.#current = signal; },
      onclick: () => {
        const { channel } = this.#picture?.targets.find((t) => t.trace.signal === signal) ?? target;
        if (channel) chooseChannel(channel);
      },
    });
  }

  /** One stop of the tab key a chart; arrows go from one thing to the next. @param {KeyboardEvent} event */
  #walk(event) {
    const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
    if (!step) return;
    event.preventDefault();
    event.stopPropagation();
    const all = /** @type {HTMLElement[]} */ ([...this.targets.children]);
    const at = all.indexOf(/** @type {HTMLElement} */ (document.activeElement));
    const next = all[(at + step + all.length) % all.length];
    for (const one of all) one.tabIndex = one === next ? 0 : -1;
    next?.focus();
  }

  #table() {
    this.paint();
    if (!this.#picture) return;
    const panel = /** @type {import('./table.js').TablePanel | null} */ (document.querySelector('ft-table'));
    panel?.show(this.chart, this.#picture.sheet, signalsOf(this.chart));
  }
}

customElements.define('ft-moment', MomentPanel);
