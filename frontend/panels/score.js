/** The score strip: how the run fares against the truth, the unprotected twin's number beside it. */
import { Panel, h, keyed, setText } from '../dom.js';
import { kept, quantity } from '../format.js';
import { store } from '../store.js';
import { nowTag } from './now.js';
/** @import {HeadlineItem} from '../types' */

export class ScoreStrip extends Panel {
  build() {
    const list = h('dl', { 'aria-label': 'Score' });
    this.append(list, nowTag(this, 'whole run, to'));
    this.watch((s) => s.score, (score) => keyed(list, score?.headline ?? [], (item) => `${(score?.headline ?? []).indexOf(item)}`, card, tell));
    this.watch((s) => s.experiment?.id, () => this.classList.toggle('waiting', !store.get().score));
  }
}

function card() {
  return h('div', {}, h('dt', {}), h('dd', { class: 'value' }), h('dd', { class: 'beside' }));
}

/** @param {HTMLElement} element @param {HeadlineItem} item */
function tell(element, item) {
  const [label, value, beside] = element.children;
  setText(label, item.label);
  setText(value, quantity(item.value, item.unit));
  const twin = item.compare_label ? `${item.compare_label} ${quantity(item.compare, item.unit)}` : '';
  setText(beside, kept([twin, item.note].filter(Boolean).join('; ')));
  element.title = [`${item.label}: ${value.textContent}. ${beside.textContent}`, item.detail].filter(Boolean).join('\n\n');
}

customElements.define('ft-score', ScoreStrip);
