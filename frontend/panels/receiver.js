/** A receiver's log of one's own: two files and where the antenna stood make an experiment. */
import { Panel, freshId, h, setText } from '../dom.js';
import { Problem, commands, read } from '../api.js';
import { sentenced } from '../format.js';
import { attempt, flyLog } from '../actions.js';
import { curlButton } from './curl.js';

const POSITION = 'Three numbers are needed, separated by commas: x, y, z in metres, Earth-fixed.';
const NUMBER = /^[-+]?\d{1,8}([.]\d*)?$/;

export class ReceiverLog extends Panel {
  /** @type {Map<string, {input: HTMLInputElement, error: HTMLElement}>} */
  #fields = new Map();
  /** @type {import('../types').LogLimits | null} */
  #limits = null;

  build() {
    this.sizes = { observation: h('small', { class: 'dim' }), navigation: h('small', { class: 'dim' }), noise_floor: h('small', { class: 'dim' }) };
    this.error = h('p', { class: 'error', role: 'alert', hidden: true });
    this.button = h('button', { class: 'primary', type: 'submit' }, 'Open');
    this.said = h('span', { class: 'dim', role: 'status' });
    const file = () => h('input', { type: 'file' });
    const form = h('form', { novalidate: true, 'data-once': true, onsubmit: (/** @type {Event} */ event) => {
      event.preventDefault();
      void attempt(() => this.#open());
    } },
      this.#field('observation', 'Observation file', file(), this.sizes.observation),
      this.#field('navigation', 'Navigation file', file(), this.sizes.navigation),
      this.#field('antenna', 'Antenna position', h('input', { type: 'text', placeholder: 'x, y, z', autocomplete: 'off', spellcheck: 'false' }),
        h('small', { class: 'dim' }, 'Optional: Earth-fixed (ECEF), in metres; errors are measured from it. Without it the position in the header of the observation file counts, which may be metres off.'), 'm'),
      this.#field('noise_floor', 'Noise floor', h('input', { type: 'text', inputmode: 'decimal', autocomplete: 'off' }), this.sizes.noise_floor, 'm'),
      this.error,
      h('div', { class: 'buttons' }, this.said, this.button, curlButton(() => commands.log(this.#form()), 'this upload')));
    this.dialog = h('dialog', { class: 'receiver', 'aria-label': 'Open a receiver log' },
      h('header', {}, h('h2', {}, 'Open a receiver log'), h('form', { method: 'dialog' }, h('button', { class: 'mini', 'aria-label': 'Close' }, '×'))),
      h('p', { class: 'dim' }, 'A GPS receiver that stands still, as RINEX 2 or 3: its own pseudoranges, to lay faults over. The files stay on this server while an experiment flies them.'), form);
    this.append(this.dialog);
  }

  open() {
    this.dialog?.showModal();
    this.#fields.get('observation')?.input.focus();
    void attempt(async () => {
      this.#limits ??= await read.logLimits();
      const { observation_bytes, navigation_bytes, epochs, noise_floor } = this.#limits;
      if (!this.sizes) return;
      setText(this.sizes.observation, `With the code on L1; at most ${megabytes(observation_bytes)} and ${epochs} epochs; plain, .gz, .Z or .crx.`);
      setText(this.sizes.navigation, `GPS, of the same day; at most ${megabytes(navigation_bytes)}.`);
      setText(this.sizes.noise_floor, `Optional: 1-sigma of a pseudorange that is assumed at every elevation; ${noise_floor} m without it. A phone or a cheap receiver needs 3 to 10; the log says what would fit.`);
    });
  }

  /** @param {string} name @param {string} label @param {HTMLInputElement} input @param {HTMLElement} hint @param {string} [unit] */
  #field(name, label, input, hint, unit) {
    const key = freshId('log');
    input.id = key;
    input.name = name;
    hint.id = `${key}-hint`;
    input.setAttribute('aria-describedby', `${key}-error ${key}-hint`);
    const error = h('span', { class: 'error', id: `${key}-error`, hidden: true });
    input.addEventListener('input', () => this.#complain(name, '', false));
    this.#fields.set(name, { input, error });
    return h('div', { class: 'field' }, h('label', { for: key }, label), h('span', { class: 'entry' }, input, unit && h('span', { class: 'unit' }, unit)), hint, error);
  }

  /** What will be sent; a place that was left empty is not. */
  #form() {
    const form = new FormData();
    for (const [name, { input }] of this.#fields) {
      const value = input.files ? input.files[0] : input.value.trim();
      if (value) form.append(name, value);
    }
    return form;
  }

  /** What is wrong before anything is sent, by field. @param {FormData} form */
  #wrong(form) {
    /** @type {[string, string][]} */
    const wrong = [];
    for (const [name, most] of /** @type {[string, number][]} */ ([['observation', this.#limits?.observation_bytes ?? Infinity], ['navigation', this.#limits?.navigation_bytes ?? Infinity]])) {
      const file = form.get(name);
      if (!(file instanceof File)) wrong.push([name, 'Choose a file.']);
      else if (file.size > most) wrong.push([name, `This file has ${(Math.ceil(file.size / 1e4) / 100).toFixed(2)} MB; at most ${megabytes(most)} are taken.`]);
    }
    const antenna = form.get('antenna');
    if (typeof antenna === 'string') {
      const parts = antenna.replaceAll('−', '-').split(',').map((part) => part.trim());
      if (parts.length === 3 && parts.every((part) => NUMBER.test(part))) form.set('antenna', parts.join(', '));
      else wrong.push(['antenna', POSITION]);
    }
    const floor = form.get('noise_floor');
    if (typeof floor === 'string') {
      const { least_noise_floor: least = 0, largest_noise_floor: most = Infinity } = this.#limits ?? {};
      if (!NUMBER.test(floor) || Number(floor) < least || Number(floor) > most) wrong.push(['noise_floor', `A number of metres is needed, from ${least} to ${most}.`]);
    }
    return wrong;
  }

  async #open() {
    const form = this.#form();
    this.#tell(this.#wrong(form));
    if (this.dialog?.querySelector('[aria-invalid="true"]')) return;
    this.#busy(true);
    try {
      await flyLog(form);
      this.dialog?.close();
    } catch (refused) {
      if (!(refused instanceof Problem)) throw refused;
      const wrong = refused.errors.filter(({ field }) => this.#fields.has(field));
      // Two files that do not fit together are one thing to say.
      const shared = wrong.length > 1 && wrong.every(({ message }) => message === refused.message);
      this.#tell(wrong.map(({ field, message }) => [field, shared ? '' : message]), wrong.length && !shared ? '' : refused.message);
    } finally {
      this.#busy(false);
    }
  }

  /** Shows what is wrong, a field without a sentence of its own only marked, and goes to the first field. @param {[string, string][]} wrong @param {string} [other] */
  #tell(wrong, other = '') {
    for (const name of this.#fields.keys()) {
      const found = wrong.find(([field]) => field === name);
      this.#complain(name, found?.[1] ?? '', !!found);
    }
    this.#fields.get(wrong[0]?.[0] ?? '')?.input.focus();
    if (this.error) {
      setText(this.error, sentenced(other));
      this.error.hidden = !other;
    }
  }

  /** @param {string} name @param {string} message @param {boolean} wrong */
  #complain(name, message, wrong) {
    const field = this.#fields.get(name);
    if (!field) return;
    setText(field.error, sentenced(message));
    field.error.hidden = !message;
    if (wrong) field.input.setAttribute('aria-invalid', 'true');
    else field.input.removeAttribute('aria-invalid');
  }

  /** @param {boolean} busy */
  #busy(busy) {
    if (this.button) this.button.disabled = busy;
    if (this.said) setText(this.said, busy ? 'Reading the log …' : '');
  }
}

/** @param {number} bytes */
function megabytes(bytes) {
  return `${Number((bytes / 1e6).toPrecision(3))} MB`;
}

customElements.define('ft-receiver', ReceiverLog);
