/** The event log: what happened and the numbers that caused it; a click looks at that moment. */
import { Panel, h, keyed, setText } from '../dom.js';
import { clock, decimalsOf } from '../format.js';
import { isCommand, reason, sentence } from '../marks.js';
import { period, store } from '../store.js';
import { look } from '../actions.js';
/** @import {Event} from '../types' */

const MOST = 250;

const SIGNS = { faults: '▼', alarms: '▲', decisions: '■', others: '●' };

/** @type {{key: keyof typeof SIGNS, label: string, of: (kind: string) => boolean}[]} */
const GROUPS = [
  { key: 'faults', label: 'Faults', of: (kind) => kind.startsWith('fault.') },
  { key: 'alarms', label: 'Alarms', of: (kind) => kind.startsWith('test.') },
  { key: 'decisions', label: 'Decisions', of: (kind) => kind.startsWith('subsystem.') && kind !== 'subsystem.switched' },
  { key: 'others', label: 'Others', of: () => true },
];

export class Log extends Panel {
  #hidden = new Set();
  #text = '';

  build() {
    this.list = h('ol', { class: 'events', tabindex: 0, 'aria-label': 'Events, newest first' });
    this.count = h('span', { class: 'dim' });
    const search = h('input', { type: 'search', class: 'find', placeholder: 'filter', 'aria-label': 'Filter events', oninput: () => {
      this.#text = search.value.toLowerCase();
      this.#draw();
    } });
    this.append(h('header', {}, h('h2', {}, 'Log'), search,
      ...GROUPS.map(({ key, label }) => {
        const button = h('button', { class: `mini ${key}-key`, 'aria-label': label, title: `Show or hide ${label.toLowerCase()}`, 'aria-pressed': 'true', onclick: () => {
          if (!this.#hidden.delete(key)) this.#hidden.add(key);
          button.setAttribute('aria-pressed', String(!this.#hidden.has(key)));
          this.#draw();
        } }, SIGNS[key], h('span', { class: 'wordy' }, ` ${label}`));
        return button;
      }), this.count), this.list);
    this.watch((s) => clock(s.experiment?.clock.duration ?? 0, Math.max(1, decimalsOf(period(s)))).length, (digits) =>
      this.list?.style.setProperty('--time', `${digits + 1}ch`));
    this.watch((s) => [s.events, s.description], () => this.#draw());
  }

  #draw() {
    const { events, description } = store.get();
    /** @type {Event[]} */
    const found = [];
    let more = 0;
    for (let i = events.length - 1; i >= 0; i -= 1) {
      const event = events[i];
      if (event.run > 0 || this.#hidden.has(groupOf(event.kind))) continue;
      if (this.#text && !`${sentence(event, description)} ${event.kind} ${event.subject}`.toLowerCase().includes(this.#text)) continue;
      if (found.length < MOST) found.push(event);
      else more += 1;
    }
    const decimals = Math.max(1, decimalsOf(period()));
    keyed(this.list ?? this, found, (e) => `${e.index}/${e.time}/${e.kind}`, (event) => {
      const group = groupOf(event.kind);
      return h('li', {}, h('button', { class: `event ${group} ${isCommand(event.kind) ? 'command' : ''}`, onclick: () => look(event.time) },
        h('span', { class: 'time' }, clock(event.time, decimals)), h('span', { class: 'sign', 'aria-hidden': 'true' }, SIGNS[group]),
        h('span', { class: 'what' }, sentence(event, description), ' ', h('span', { class: 'why' }, reason(event, description)))));
    });
    if (this.count) setText(this.count, more ? `${found.length} of ${found.length + more}` : String(found.length || ''));
  }
}

/** @param {string} kind @returns {keyof typeof SIGNS} */
function groupOf(kind) {
  return GROUPS.find((g) => g.of(kind))?.key ?? 'others';
}

customElements.define('ft-log', Log);
