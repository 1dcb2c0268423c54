/** Detector settings: the form the system declares, every change applied at once. */
import { Panel, freshId, h, keyed } from '../dom.js';
import { Problem, commands } from '../api.js';
import { bounds, control, fieldLabel, needed, resolved, show, valueOf } from '../schema.js';
import { sentenced, unitText } from '../format.js';
import { store } from '../store.js';
import { configure, id, openDialog } from '../actions.js';
import { curlButton } from './curl.js';
/** @import {Schema} from '../types' */

/** One setting: label, control, unit, and what is wrong with it. */
export class Setting extends Panel {
  build() {
    if (this.firstChild) return;
    const name = this.dataset.setting ?? '';
    const { description, experiment } = store.get();
    const root = description?.settings_schema ?? {};
    const schema = resolved(root.properties?.[name] ?? {}, root);
    const key = freshId('setting');
    const input = control(schema, experiment?.settings[name], { id: key, describedby: `${key}-error` });
    const error = h('span', { class: 'error', id: `${key}-error`, hidden: true });
    const limits = bounds(schema);
    input.title = [schema.description, limits && `${limits} ${unitText(schema.unit)}`].filter(Boolean).join('. ');
    input.addEventListener('change', () => this.#apply(name, schema, input, error));
    this.className = 'field';
    this.append(h('label', { for: key, title: schema.description }, fieldLabel(name, schema)),
      h('span', { class: 'entry' }, input, h('span', { class: 'unit' }, unitText(schema.unit)),
        curlButton(() => commands.configure(id(), { [name]: valueOf(schema, input) }), fieldLabel(name, schema))), error);
    this.watch((s) => s.experiment?.settings[name], (value) => show(schema, input, value));
    this.watch((s) => name in (s.experiment?.idle_settings ?? {}), (idle) => {
      this.hidden = idle;
    });
  }

  /** @param {string} name @param {Schema} schema @param {HTMLInputElement | HTMLSelectElement} input @param {HTMLElement} error */
  async #apply(name, schema, input, error) {
    const value = valueOf(schema, input);
    const complain = (/** @type {string} */ text) => {
      error.textContent = text;
      error.hidden = !text;
      input.setAttribute('aria-invalid', String(!!text));
    };
    if (value === undefined) return complain(`${needed(schema)}${input.value.trim() && `, not “${input.value}”`}.`);
    try {
      await configure({ [name]: value });
      return complain('');
    } catch (refused) {
      if (!(refused instanceof Problem)) throw refused;
      return complain(sentenced(refused.about(name) ?? refused.message));
    }
  }
}

customElements.define('ft-setting', Setting);

/** @param {string} name */
export function settingField(name) {
  const element = document.createElement('ft-setting');
  element.dataset.setting = name;
  return element;
}

export class Settings extends Panel {
  build() {
    const list = h('div', { class: 'fields' });
    const heading = h('h2', {}, 'Detection');
    const parameters = h('div', { class: 'buttons' }, h('button', { class: 'wide', title: 'What is fixed when an experiment starts: geometry, noise, flight (p)', onclick: () => openDialog('ft-parameters') }, 'Parameters …'));
    this.append(heading, list, parameters);
    this.watch((s) => s.description, (description) => {
      const names = Object.keys(description?.settings_schema.properties ?? {});
      keyed(list, names, (name) => `${description?.id}/${name}`, settingField);
      heading.hidden = !names.length;
      parameters.hidden = !Object.keys(description?.parameters_schema.properties ?? {}).length;
    });
  }
}

customElements.define('ft-settings', Settings);
