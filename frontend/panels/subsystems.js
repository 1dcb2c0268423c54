/** Switches of the subsystems, with their health beside them. */
import { Panel, fill, freshId, h, keyed } from '../dom.js';
import { commands } from '../api.js';
import { HEALTH, healthSign } from '../health.js';
import { store } from '../store.js';
import { id, switchSubsystem } from '../actions.js';
import { curlButton } from './curl.js';
import { nowTag } from './now.js';
/** @import {Event, Subsystem} from '../types' */

export class Subsystems extends Panel {
  build() {
    const list = h('ul', { class: 'subsystems' });
    this.append(h('h2', {}, 'Subsystems', nowTag(this)), list);
    this.watch((s) => [s.description, s.experiment?.subsystems, s.cursor, s.cursor === null ? null : s.events], () => {
      keyed(list, store.get().description?.subsystems ?? [], (s) => s.name, row, tell);
    });
  }
}

/** @param {Subsystem} subsystem */
function row(subsystem) {
  const key = freshId('switch');
  const box = h('input', { type: 'checkbox', id: key, role: 'switch', onchange: () => switchSubsystem(subsystem.name, box.checked) });
  return h('li', {}, h('label', { for: key }, box, h('span', { class: 'name' }, subsystem.label)), h('span', { class: 'how' }),
    curlButton(() => commands.switch(id(), subsystem.name, box.checked), `the switch of ${subsystem.label}`));
}

/** @param {HTMLElement} element @param {Subsystem} subsystem */
function tell(element, subsystem) {
  const state = store.get().experiment?.subsystems[subsystem.name];
  const box = element.querySelector('input');
  const how = element.querySelector('.how');
  if (!state || !box || !how) return;
  box.checked = state.enabled;
  // Switched on again, a subsystem is back with the next epoch; until then its health is still the old one.
  const returning = state.enabled && state.health === 'off';
  const health = !state.enabled ? 'off' : returning ? 'ok' : state.health;
  const used = !state.enabled ? '' : returning ? ', from the next epoch' : state.used ? ', used' : ', not used';
  const { cursor, events } = store.get();
  const then = cursor === null ? '' : `; then ${past(subsystem.name, cursor, events)}`;
  const text = `${returning ? 'on' : HEALTH[health].word}${used}${then}`;
  if (how.textContent !== text) fill(how, healthSign(health), text);
}

/** What the navigator had done with a subsystem by a moment. @param {string} name @param {number} time @param {Event[]} events */
function past(name, time, events) {
  let state = 'not isolated';
  for (const { kind, subject, run, time: at, detail } of events) {
    if (at > time + 1e-9) break;
    if (subject !== name || run > 0) continue;
    if (kind === 'subsystem.isolated') state = HEALTH.isolated.word;
    else if (kind === 'subsystem.readmitted') state = 'not isolated';
    else if (kind === 'subsystem.switched') state = detail.enabled ? 'not isolated' : HEALTH.off.word;
  }
  return state;
}

customElements.define('ft-subsystems', Subsystems);
