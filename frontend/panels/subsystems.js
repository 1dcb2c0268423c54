/** Switches of the subsystems, with their health beside them. */
import { Panel, fill, freshId, h, keyed } from '../dom.js';
import { commands } from '../api.js';
import { HEALTH, healthSign } from '../health.js';
import { store } from '../store.js';
import { id, switchSubsystem } from '../actions.js';
import { curlButton } from './curl.js';
/** @import {Subsystem} from '../types' */

export class Subsystems extends Panel {
  build() {
    const list = h('ul', { class: 'subsystems' });
    this.append(h('h2', {}, 'Subsystems'), list);
    this.watch((s) => [s.description, s.experiment?.subsystems], () => {
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
  const text = `${returning ? 'on' : HEALTH[health].word}${used}`;
  if (how.textContent !== text) fill(how, healthSign(health), text);
}

customElements.define('ft-subsystems', Subsystems);
