/** Asks before something is done that cannot be undone. */
import { Panel, fill, h } from '../dom.js';

export class Confirm extends Panel {
  /** @type {((agreed: boolean) => void) | null} */
  #answer = null;

  build() {
    this.dialog = h('dialog', { class: 'confirm', 'aria-label': 'Are you sure?', onclose: () => this.#settle(this.dialog?.returnValue === 'yes') });
    this.append(this.dialog);
  }

  /** @param {string} title @param {string[]} sentences @param {string} yes what the button does @returns {Promise<boolean>} */
  ask(title, sentences, yes) {
    this.#settle(false);
    fill(this.dialog ?? this, h('form', { method: 'dialog', 'data-once': true }, h('h2', {}, title), ...sentences.map((text) => h('p', {}, text)),
      h('div', { class: 'buttons' }, h('button', { value: 'no' }, 'Keep'), h('button', { class: 'primary', value: 'yes' }, yes))));
    if (this.dialog) this.dialog.returnValue = '';
    this.dialog?.showModal();
    return new Promise((resolve) => { this.#answer = resolve; });
  }

  /** @param {boolean} agreed */
  #settle(agreed) {
    this.#answer?.(agreed);
    this.#answer = null;
  }
}

/** @param {string} title @param {string[]} sentences @param {string} yes @returns {Promise<boolean>} */
export function sure(title, sentences, yes) {
  const panel = /** @type {Confirm | null} */ (document.querySelector('ft-confirm'));
  return panel ? panel.ask(title, sentences, yes) : Promise.resolve(false);
}

customElements.define('ft-confirm', Confirm);
