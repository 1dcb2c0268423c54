/** Faults that are live or armed, each with what became of it, and the way to clear it. */
import { Panel, h, keyed, setText } from '../dom.js';
import { commands } from '../api.js';
import { clock, decimalsOf } from '../format.js';
import { derive, faultText } from '../marks.js';
import { period, store } from '../store.js';
import { clear, clearAll, id } from '../actions.js';
import { curlButton } from './curl.js';
import { moment, nowTag } from './now.js';
/** @import {Event, Fault} from '../types' */

export class Faults extends Panel {
  build() {
    const list = h('ul', { class: 'faults' });
    const none = h('p', { class: 'dim none' }, 'None. Every sensor is sound.');
    const all = h('div', { class: 'buttons' }, h('button', { class: 'wide', title: 'Clear all faults (c)', onclick: clearAll }, 'Clear all'), curlButton(() => commands.clearAll(id()), 'clear all'));
    const then = h('p', { class: 'dim then', hidden: true });
    this.append(h('h2', {}, 'Live faults', nowTag(this)), list, none, all, then);
    this.watch((s) => [s.cursor, s.cursor === null ? null : s.events, s.description], () => {
      const { cursor, events, description } = store.get();
      then.hidden = cursor === null;
      if (cursor === null) return;
      const live = derive(events, description).spans.filter((s) => s.row === 'injected' && s.start <= cursor + 1e-9 && (s.end === null || cursor < s.end));
      setText(then, `At ${moment(cursor)}: ${live.map((s) => s.label).join('; ') || 'no fault was live'}.`);
    });
    this.watch((s) => [s.experiment?.faults, s.events, s.description], () => {
      const faults = (store.get().experiment?.faults ?? []).filter((f) => f.state !== 'ended');
      keyed(list, faults, (f) => f.id, card, tell);
      none.hidden = faults.length > 0;
      all.hidden = faults.length === 0;
    });
  }
}

/** @param {Fault} fault */
function card(fault) {
  return h('li', { class: 'fault' }, h('b', {}),
    h('span', { class: 'dim' }),
    h('span', { class: 'acts' }, curlButton(() => commands.clear(id(), fault.id), 'this clear'), h('button', { class: 'clear', onclick: () => clear(fault.id) }, 'Clear')),
    h('span', { class: 'dim deeds' }));
}

/** @param {HTMLElement} element @param {Fault} fault */
function tell(element, fault) {
  const { description, events } = store.get();
  const title = faultText(fault, description);
  element.classList.toggle('armed', fault.state === 'armed');
  const [name, about, , deeds] = element.children;
  setText(name, title);
  element.querySelector('.clear')?.setAttribute('aria-label', `Clear ${title}`);
  setText(about, fault.state === 'armed' ? `armed for ${at(fault.start)}` : `since ${at(fault.start)}${found(fault, events)}`);
  const silent = fault.state !== 'armed' && !fault.acting;
  element.classList.toggle('silent', silent);
  setText(deeds, fault.acting ? `acting: ${fault.acted_epochs} ${fault.acted_epochs === 1 ? 'epoch' : 'epochs'}` : silent ? `silent: ${fault.silent_because}` : '');
}

/** A moment, to the epoch. @param {number} time */
const at = (time) => clock(time, Math.max(1, decimalsOf(period())));

/** Who noticed, and when. @param {Fault} fault @param {Event[]} events */
function found(fault, events) {
  const sensor = store.get().description?.channels.find((c) => c.name === fault.channel)?.sensor ?? fault.channel;
  /** @param {string} subject */
  const concerns = (subject) => subject === sensor || subject.startsWith(`${sensor}.`) || sensor.startsWith(`${subject}.`);
  const after = events.filter((e) => e.time >= fault.start - 1e-9 && e.run <= 0 && concerns(e.subject));
  const isolated = after.find((e) => e.kind === 'subsystem.isolated');
  if (isolated) return `, isolated ${at(isolated.time)}`;
  const before = store.get().experiment?.subsystems;
  const already = Object.entries(before ?? {}).some(([name, s]) => concerns(name) && s.health === 'isolated');
  if (already) return ', isolated already';
  const alarm = after.find((e) => e.kind === 'test.alarmed');
  return alarm ? `, alarm ${at(alarm.time)}, not isolated` : ', not noticed yet';
}

customElements.define('ft-faults', Faults);
