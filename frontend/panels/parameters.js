/** What is fixed when an experiment starts: a form of it, the figures that follow from it at once, and a new experiment with it. */
import { Panel, fill, h, keyed, setText } from '../dom.js';
import { Problem, commands, read, send } from '../api.js';
import { Form } from '../form.js';
import { number, quantity, unitText } from '../format.js';
import { store } from '../store.js';
import { attempt, id, say, start } from '../actions.js';
import { curlButton } from './curl.js';
/** @import {Indicator} from '../types' */

const PAUSE = 250;
/** Longest title of an experiment that tells what was changed. */
const LONGEST = 80;

export class Parameters extends Panel {
  /** @type {Record<string, any>} */
  #document = {};
  /** @type {Form | null} */
  #form = null;
  /** @type {Form | null} */
  #run = null;
  /** Figures of the parameters that the experiment has. @type {Map<string, Indicator>} */
  #before = new Map();
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  #timer;
  #asked = 0;

  build() {
    this.fields = h('div', { class: 'sheet', tabindex: 0, role: 'region', 'aria-label': 'Parameters' });
    this.figures = h('ul', { class: 'figures', 'aria-label': 'Figures that follow' });
    this.side = h('aside', {}, h('h3', {}, 'What follows from them'), this.figures);
    this.error = h('p', { class: 'error', role: 'alert', hidden: true });
    this.what = h('span', { class: 'dim' });
    const find = h('input', { type: 'search', class: 'find', placeholder: 'find', 'aria-label': 'Find a parameter', oninput: () => this.#form?.filter(find.value) });
    this.find = find;
    const form = h('form', { novalidate: true, 'data-once': true, onsubmit: (/** @type {Event} */ event) => {
      event.preventDefault();
      void attempt(() => this.#start());
    } },
      h('div', { class: 'both' }, this.fields, this.side), this.error,
      h('div', { class: 'buttons' }, this.what, h('button', { class: 'primary', type: 'submit' }, 'Start a new experiment with these'),
        curlButton(() => commands.create(this.#scenario(), this.#title()), 'this experiment')));
    this.dialog = h('dialog', { class: 'parameters-of', 'aria-label': 'Parameters' },
      h('header', {}, h('h2', {}, 'Parameters'), find, h('form', { method: 'dialog' }, h('button', { class: 'mini', 'aria-label': 'Close' }, '×'))),
      h('p', { class: 'dim' }, 'They are fixed when an experiment starts, so a change makes a new one: same faults and commands; the open one stays as it is.'), form);
    this.append(this.dialog);
  }

  open() {
    void attempt(async () => {
      const { description } = store.get();
      if (!description) return;
      this.#document = await read.document(id());
      const called = (/** @type {string} */ name) => description.subsystems.find((s) => s.name === name)?.label;
      const { seed, duration } = this.#document;
      this.#run = new Form({ type: 'object', properties: {
        seed: { type: 'integer', minimum: 0, default: seed, description: 'another seed, another noise' },
        duration: { type: 'number', exclusiveMinimum: 0, unit: 's', default: duration, description: 'how long it flies' },
      } }, () => this.#changed(), { origin: 'was' });
      this.#form = new Form(description.parameters_schema, () => this.#changed(), { called });
      fill(this.fields ?? this, h('fieldset', {}, h('legend', {}, 'Run'), this.#run.element), this.#form.element);
      this.#run.write({});
      this.#form.write(this.#document.parameters ?? {});
      if (this.find) this.find.value = '';
      this.#refuse('');
      this.#before = new Map();
      fill(this.figures ?? this);
      if (this.side) this.side.hidden = true;
      const found = await this.#ask(this.#form.read().values).catch(() => []);
      this.#before = new Map(found.map((one) => [one.id, one]));
      this.#draw(found);
      this.dialog?.showModal();
      if (this.fields) this.fields.scrollTop = 0;
      this.#run.focus('seed');
    });
  }

  /** The scenario as the form has it. */
  #scenario() {
    const kept = Object.fromEntries(Object.entries(this.#document.parameters ?? {}).filter(([name]) => !this.#known(name)));
    return { ...this.#document, ...this.#run?.read().values, parameters: { ...kept, ...this.#form?.read().values } };
  }

  /** What makes it another experiment, to know it by. */
  #title() {
    const told = [...(this.#run?.changes() ?? []), ...(this.#form?.changes() ?? [])].join('; ');
    return told.length > LONGEST ? `${told.slice(0, LONGEST - 1)}…` : told;
  }

  /** Whether the form has a field or a group of this name; what it has not is left as it is. @param {string} name */
  #known(name) {
    return !!this.#form?.element.querySelector(`[data-path="${name}"], [data-path^="${name}."]`);
  }

  /** @param {Record<string, any>} parameters @returns {Promise<Indicator[]>} */
  #ask(parameters) {
    const { description, experiment } = store.get();
    return send(commands.indicators(description?.id ?? '', { parameters, settings: experiment?.settings ?? {} }));
  }

  #changed() {
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => void attempt(() => this.#follow()), PAUSE);
  }

  /** What follows from what is typed, or what is wrong with it. */
  async #follow() {
    const turn = (this.#asked += 1);
    const { values, wrong } = this.#form?.read() ?? { values: {}, wrong: [] };
    this.#form?.complain(wrong);
    this.#run?.complain(this.#run.read().wrong);
    this.figures?.classList.toggle('stale', wrong.length > 0);
    if (wrong.length) return;
    try {
      const found = await this.#ask(values);
      if (turn !== this.#asked) return;
      this.#refuse('');
      this.#draw(found);
    } catch (refused) {
      if (!(refused instanceof Problem)) throw refused;
      if (turn === this.#asked) this.#complain(refused);
    }
    this.figures?.classList.toggle('stale', !this.error?.hidden || !!this.fields?.querySelector('[aria-invalid]'));
  }

  /** @param {Problem} refused */
  #complain(refused) {
    const errors = refused.errors.map((e) => ({ field: e.field.replace(/^scenario\./, ''), message: e.message }));
    const inside = errors.filter((e) => e.field.startsWith('parameters.')).map((e) => ({ ...e, field: e.field.slice('parameters.'.length) }));
    const rest = [...(this.#form?.complain(inside) ?? []), ...(this.#run?.complain(errors.filter((e) => !e.field.startsWith('parameters.'))) ?? [])];
    this.#refuse(rest.length || !errors.length ? [...new Set(rest.map((e) => e.message))].join(' ') || refused.message : '');
  }

  /** @param {string} text */
  #refuse(text) {
    if (!this.error) return;
    setText(this.error, text);
    this.error.hidden = !text;
  }

  /** @param {Indicator[]} found */
  #draw(found) {
    if (!this.figures || !this.side) return;
    this.side.hidden = !found.length;
    keyed(this.figures, found, (one) => one.id, () => h('li', {}), (element, one) => tell(element, one, this.#before.get(one.id), (field) => this.#form?.focus(field)));
  }

  async #start() {
    clearTimeout(this.#timer);
    const wrong = this.#form?.read().wrong ?? [];
    const odd = this.#run?.read().wrong ?? [];
    this.#form?.complain(wrong);
    this.#run?.complain(odd);
    if (wrong.length || odd.length) {
      (odd.length ? this.#run : this.#form)?.focus();
      return;
    }
    try {
      await start(this.#scenario(), this.#title());
    } catch (refused) {
      if (!(refused instanceof Problem) || refused.status === 429) throw refused;
      this.#complain(refused);
      this.#form?.focus();
      return;
    }
    this.dialog?.close();
    say({ tone: 'info', text: 'A new experiment with these parameters, paused at the start. The former one is under All experiments.' });
  }
}

/** One figure: now, at best, before; and where along a line something is so. @param {HTMLElement} element @param {Indicator} one @param {Indicator | undefined} before @param {(field: string) => void} go */
function tell(element, one, before, go) {
  const digits = 4;
  const beside = [];
  if (one.ideal !== null) beside.push(`best ${quantity(one.ideal, one.unit, digits)}`);
  if (before && number(before.value, digits) !== number(one.value, digits)) beside.push(`was ${quantity(before.value, one.unit, digits)}`);
  element.title = one.note;
  const { field } = one;
  const name = field ? h('button', { class: 'name', type: 'button', title: `${one.note} Go to its field.`, onclick: () => go(field) }, one.label) : h('span', {}, one.label);
  fill(element, name, h('b', {}, quantity(one.value, one.unit, digits)), h('small', { class: 'dim' }, beside.join(', ')),
    one.map && strip(one.map));
}

/** @param {NonNullable<Indicator['map']>} map */
function strip(map) {
  const share = (/** @type {number} */ value) => `${(100 * (value - map.low)) / (map.high - map.low)}%`;
  const unit = unitText(map.unit);
  const words = map.bands.map((b) => `${b.label}: ${number(b.start)} to ${number(b.end)}${unit}`).join('; ') || 'nowhere';
  return h('div', { class: 'strip', role: 'img', 'aria-label': `${map.label}: ${words}`, title: `${map.label}\n${words}` },
    h('span', { class: 'line' }, ...map.bands.map((band, i) => h('i', { class: i % 2 ? 'odd' : '', style: { left: share(band.start), width: `calc(${share(band.end)} - ${share(band.start)})` } }))),
    h('small', { class: 'dim' }, h('span', {}, `${number(map.low)}${unit}`), h('span', {}, `${number(map.high)}${unit}`)));
}

customElements.define('ft-parameters', Parameters);
