/** The fault form: drawn from the schema of a fault and from what each channel takes. */
import { Panel, fill, freshId, h, setText } from '../dom.js';
import { Problem, commands } from '../api.js';
import { isTime, needed, numberIn, resolved, timeIn } from '../schema.js';
import { capital, clock, sentenced, unitText, words } from '../format.js';
import { faultText, fitted, subjectLabel, unseen } from '../marks.js';
import { store } from '../store.js';
import { id, inject, say } from '../actions.js';
import { curlButton } from './curl.js';
/** @import {Channel, KindInfo} from '../types' */

const FIELDS = ['channel', 'kind', 'magnitude', 'start', 'end'];

export class Bench extends Panel {
  /** @type {Map<string, {row: HTMLElement, error: HTMLElement, input: HTMLInputElement | HTMLSelectElement}>} */
  #fields = new Map();
  /** Magnitudes the person typed are kept when only the channel changes within a unit. */
  #suggested = '';
  /** The person has chosen the channel; it is not the list's first by chance. */
  #picked = false;
  /** An injection is under way. */
  #busy = false;

  build() {
    this.search = h('input', { type: 'search', id: 'find-channel', placeholder: 'any channel', 'aria-label': 'Find a channel', oninput: () => this.#list() });
    this.channel = h('select', { onchange: () => {
      this.#picked = true;
      this.#kinds();
    } });
    this.kind = h('select', { onchange: () => this.#shape() });
    this.magnitude = h('input', { type: 'text', inputmode: 'decimal', autocomplete: 'off' });
    this.start = h('input', { type: 'text', inputmode: 'decimal', placeholder: 'now', autocomplete: 'off' });
    this.end = h('input', { type: 'text', inputmode: 'decimal', placeholder: 'never', autocomplete: 'off' });
    this.unit = h('span', { class: 'unit' });
    this.sentence = h('p', { class: 'sentence' });
    this.extra = h('div', { class: 'fields' });
    this.button = h('button', { class: 'primary wide', type: 'submit' }, 'Inject');
    const seconds = () => h('span', { class: 'unit', title: 'Seconds (150), or minutes and seconds (2:30)' }, 's');
    this.append(h('h2', {}, 'Inject a fault'), h('form', {
      class: 'fields', novalidate: true, 'data-once': true, 'aria-label': 'Inject a fault', onsubmit: (/** @type {Event} */ event) => {
        event.preventDefault();
        void this.#inject();
      },
    },
      h('div', { class: 'field' }, h('label', { for: 'find-channel' }, 'Find'), h('span', { class: 'entry' }, this.search)),
      this.#field('channel', 'Channel', this.channel), this.#field('kind', 'Kind', this.kind), this.sentence,
      this.#field('magnitude', 'Magnitude', this.magnitude, this.unit), this.extra,
      this.#field('start', 'Start', this.start, seconds()), this.#field('end', 'End', this.end, seconds()),
      h('div', { class: 'buttons' }, this.button, curlButton(() => commands.inject(id(), this.#fault()), 'this injection'))));
    this.watch((s) => [s.description, Object.keys(s.experiment?.unavailable ?? {}).join(' ')], () => {
      if (this.search) this.search.value = '';
      this.#picked = false;
      this.#list();
    });
    this.watch((s) => [...unseen(s.experiment)].join(' '), () => {
      if (document.activeElement !== this.channel) this.#list();
    });
    this.watch((s) => s.prefill, (prefill) => {
      if (!prefill || !this.search || !this.channel) return;
      this.search.value = '';
      this.#list();
      this.channel.value = prefill.channel;
      this.#kinds();
    });
    this.watch((s) => [s.experiment?.id, s.experiment?.clock.state], () => {
      if (this.button) this.button.disabled = !store.get().experiment || store.get().experiment?.clock.state === 'failed';
    });
  }

  /** Chooses a channel, as the form's own list would. @param {string} channel */
  choose(channel) {
    this.#picked = true;
    store.set({ prefill: { channel } });
  }

  focusForm() {
    this.channel?.focus();
    this.scrollIntoView({ block: 'nearest' });
  }

  #channels() {
    return fitted(store.get());
  }

  /** @param {string} name @param {string} label @param {HTMLInputElement | HTMLSelectElement} input @param {HTMLElement} [unit] */
  #field(name, label, input, unit) {
    const key = freshId('fault');
    input.id = key;
    input.setAttribute('name', name);
    input.setAttribute('aria-describedby', `${key}-error`);
    const error = h('span', { class: 'error', id: `${key}-error`, hidden: true });
    const row = h('div', { class: 'field' }, h('label', { for: key }, label), h('span', { class: 'entry' }, input, unit), error);
    this.#fields.set(name, { row, error, input });
    return row;
  }

  /** Channels that match the search, by sensor. */
  #list() {
    const { description } = store.get();
    if (!this.channel || !this.search) return;
    const asked = this.search.value.toLowerCase().split(/\s+/).filter(Boolean);
    const found = this.#channels().filter((c) => asked.every((word) => `${c.label} ${c.name} ${c.unit}`.toLowerCase().includes(word)));
    const before = this.channel.value;
    const absent = unseen(store.get().experiment);
    const [here, away] = [found.filter((c) => !absent.has(c.name)), found.filter((c) => absent.has(c.name))];
    const family = (/** @type {Channel} */ c) => `${subjectLabel(c.group.split('.')[0], description)}: ${words(c.group.split('.').slice(1).join(' '))} (${c.unit})`;
    fill(this.channel, ...grouped(here, family), ...grouped(away, (c) => `Not in view now – ${family(c)}`),
      !found.length && h('option', { value: '', disabled: true }, 'no channel matches'));
    const kept = found.some((c) => c.name === before) && !(absent.has(before) && !this.#picked);
    this.channel.value = kept ? before : ([...here, ...away][0]?.name ?? '');
    this.#kinds();
  }

  /** @returns {Channel | undefined} */
  #chosen() {
    return this.#channels().find((c) => c.name === this.channel?.value);
  }

  #kinds() {
    const channel = this.#chosen();
    if (!this.kind) return;
    const before = this.kind.value;
    fill(this.kind, ...(channel?.kinds ?? []).map((kind) => h('option', { value: kind }, channel?.faults[kind]?.label ?? words(kind))));
    if (channel?.kinds.includes(before)) this.kind.value = before;
    if (this.channel) this.channel.title = channel?.name ?? '';
    this.#shape();
  }

  /** Fields that this kind has, with a size worth trying. */
  #shape() {
    const channel = this.#chosen();
    const info = channel?.faults[this.kind?.value ?? ''];
    if (!this.magnitude || !this.unit || !this.sentence || !this.extra) return;
    setText(this.sentence, info ? `${capital(info.sentence)}.` : '');
    const sized = this.#fields.get('magnitude');
    if (sized) sized.row.hidden = !info || info.unit === null;
    setText(this.unit, unitText(info?.unit) || (info?.unit === '1' ? '(ratio)' : ''));
    const suggestion = channel && info ? typical(channel, info) : '';
    if (this.magnitude.value === this.#suggested || this.magnitude.dataset.unit !== String(info?.unit)) this.magnitude.value = suggestion;
    this.magnitude.dataset.unit = String(info?.unit);
    this.#suggested = suggestion;
    const schema = store.get().description?.fault_schema ?? {};
    for (const name of [...this.#fields.keys()]) if (!FIELDS.includes(name)) this.#fields.delete(name);
    fill(this.extra, ...(info?.parameters ?? []).map((name) => {
      const property = resolved(schema.properties?.[name] ?? {}, schema);
      const input = h('input', { type: 'text', inputmode: 'decimal', value: property.default ?? '', title: property.description });
      return this.#field(name, capital(words(name)), input, h('span', { class: 'unit' }, unitText(property.unit)));
    }));
    this.extra.hidden = !info?.parameters.length;
    this.#complain(new Map());
  }

  /** Whether a field holds seconds, which may be typed as 2:30. @param {string} name */
  #timed(name) {
    if (name === 'magnitude') return this.#chosen()?.faults[this.kind?.value ?? '']?.unit === 's';
    return name === 'start' || name === 'end' || isTime(this.#property(name));
  }

  /** What the schema of a fault says of a field. @param {string} name */
  #property(name) {
    const schema = store.get().description?.fault_schema ?? {};
    return resolved(schema.properties?.[name] ?? {}, schema);
  }

  /** What is missing or no number, by field. @param {Record<string, unknown>} fault */
  #amiss(fault) {
    /** @type {Map<string, string>} */
    const wrong = new Map();
    if (!this.channel?.value) wrong.set('channel', 'Choose a channel; none matches the search.');
    for (const [name, { input, row }] of this.#fields) {
      if (name === 'channel' || name === 'kind' || row.hidden || typeof fault[name] === 'number') continue;
      const text = input.value.trim();
      const optional = name === 'start' || name === 'end';
      if (optional && !(name in fault)) continue;
      const unit = unitText(this.#chosen()?.faults[this.kind?.value ?? '']?.unit);
      if (!text && name === 'magnitude') wrong.set(name, `A magnitude is needed: how large the fault is${unit ? `, in ${unit}` : ''}.`);
      else {
        const schema = { ...this.#property(name), type: 'number', ...(this.#timed(name) && { unit: 's' }) };
        wrong.set(name, `${needed(optional || name === 'magnitude' ? { type: 'number', unit: schema.unit === 's' ? 's' : '' } : schema)}${text && `, not “${text}”`}.`);
      }
    }
    return wrong;
  }

  /** The fault as the form has it; text that is no number is passed on, for the server to name the field. */
  #fault() {
    /** @type {Record<string, unknown>} */
    const fault = { channel: this.channel?.value ?? '', kind: this.kind?.value ?? '' };
    for (const [name, { input, row }] of this.#fields) {
      if (name === 'channel' || name === 'kind' || row.hidden || input.value.trim() === '' || input.value.trim() === input.getAttribute('placeholder')) continue;
      fault[name] = (this.#timed(name) ? timeIn(input.value) : numberIn(input.value)) ?? input.value;
    }
    return fault;
  }

  async #inject() {
    if (this.#busy) return;
    const fault = this.#fault();
    const wrong = this.#amiss(fault);
    this.#complain(wrong);
    if (wrong.size) return;
    this.#busy = true;
    try {
      const made = await inject(fault);
      // Whether it waits is the server's to say: the page's own time may be an epoch behind.
      const how = made.state === 'armed' ? `armed for ${clock(made.start, 1)}` : 'injected';
      say({ tone: 'info', text: `${faultText(made, store.get().description)} ${how}.` });
    } catch (refused) {
      if (!(refused instanceof Problem)) throw refused;
      for (const name of this.#fields.keys()) {
        const about = refused.about(name);
        if (about) wrong.set(name, sentenced(about));
      }
      this.#complain(wrong);
      if (!wrong.size) say({ tone: 'error', text: sentenced(refused.message) });
    } finally {
      this.#busy = false;
    }
  }

  /** @param {Map<string, string>} wrong what is wrong, by field */
  #complain(wrong) {
    let first = true;
    for (const [name, { error, input }] of this.#fields) {
      const text = wrong.get(name) ?? '';
      setText(error, text);
      error.hidden = !text;
      if (text) input.setAttribute('aria-invalid', 'true');
      else input.removeAttribute('aria-invalid');
      if (text && first) {
        input.focus();
        first = false;
      }
    }
  }
}

/** @param {Channel[]} channels @param {(channel: Channel) => string} label */
function grouped(channels, label) {
  return [...Map.groupBy(channels, label)].map(([name, members]) =>
    h('optgroup', { label: name }, ...members.map((c) => h('option', { value: c.name }, c.label))));
}

/** A magnitude worth trying first. @param {Channel} channel @param {KindInfo} info */
function typical(channel, info) {
  if (info.unit === null) return '';
  if (info.unit === channel.unit) return String(channel.typical);
  if (info.unit.startsWith(`${channel.unit}/`)) return String(Number((channel.typical / 10).toPrecision(3)));
  return info.unit === 's' ? '1' : '0.01';
}

customElements.define('ft-bench', Bench);
