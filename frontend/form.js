/**
 * A form drawn from a JSON Schema of nested objects: numbers with unit, bounds and source, choices, rows of numbers, tables,
 * and what is too free for any of these as JSON. Errors stand at their fields.
 * @import {Schema} from './types'
 */
import { fill, freshId, h, setText } from './dom.js';
import { capital, unitText, words } from './format.js';
import { bounds, control, fieldLabel, needed, numberIn, resolved, valueOf } from './schema.js';

/** @typedef {{read: () => unknown, write: (value: unknown) => void, element: HTMLElement, focus: () => void}} Editor */
/** @typedef {{path: string, schema: Schema, editor: Editor, row: HTMLElement, error: HTMLElement, reset: HTMLButtonElement}} Field */

/** Thrown by an editor whose text is no value; the message is shown at its field. */
class NoValue extends Error {}

export class Form {
  /** @type {Field[]} */
  #fields = [];

  /**
   * @param {Schema} root schema of the whole
   * @param {() => void} changed called at every change
   * @param {{called?: (name: string) => string | undefined, origin?: string}} [words] what a group or field is called, where
   *   its name is no word, and what the values are called that fields can be set back to
   */
  constructor(root, changed, { called = () => undefined, origin = 'default' } = {}) {
    this.root = root;
    this.changed = changed;
    this.called = called;
    this.origin = origin;
    this.element = h('div', { class: 'parameters' });
    const loose = this.#group(root, '', this.element);
    if (loose) this.element.prepend(loose);
  }

  /** Fields of an object; its objects become groups of their own. @param {Schema} schema @param {string} path @param {HTMLElement} into @returns {HTMLElement | null} */
  #group(schema, path, into) {
    const rows = h('div', { class: 'rows' });
    for (const [name, property] of Object.entries(schema.properties ?? {})) {
      const inner = resolved(property, this.root);
      const at = path ? `${path}.${name}` : name;
      if (inner.type === 'object' && inner.properties) {
        // Something that may be absent is not begun here: it takes more than numbers to make it.
        if (inner.default === null) continue;
        const group = h('fieldset', {}, h('legend', {}, this.called(name) ?? capital(words(name))), inner.description && h('p', { class: 'dim' }, inner.description));
        const own = this.#group(inner, at, group);
        if (own) group.append(own);
        into.append(group);
      } else rows.append(this.#field(name, at, inner));
    }
    return rows.children.length ? rows : null;
  }

  /** @param {string} name @param {string} path @param {Schema} schema */
  #field(name, path, schema) {
    const key = freshId('parameter');
    const error = h('span', { class: 'error', id: `${key}-error`, hidden: true });
    const label = this.called(name) ?? fieldLabel(name, schema);
    const editor = this.#editor(schema, key, label);
    const reset = h('button', { class: 'mini', type: 'button', hidden: true, onclick: () => {
      editor.write(schema.default);
      this.#touched();
    } }, `${this.origin} ${told(schema.default)}`);
    reset.setAttribute('aria-label', `Set ${label} back to ${told(schema.default)}`);
    const limits = bounds(schema);
    const about = [schema.description, limits, schema.source].filter(Boolean).join(' · ');
    editor.element.addEventListener('input', () => this.#touched());
    const row = h('div', { class: 'field', 'data-path': path },
      h('label', { for: key, title: about }, label),
      h('span', { class: 'entry' }, editor.element, h('span', { class: 'unit' }, unitText(schema.unit)), reset),
      h('small', { class: 'dim', title: about }, about), error);
    this.#fields.push({ path, schema, editor, row, error, reset });
    return row;
  }

  /** @param {Schema} schema @param {string} key @param {string} label @returns {Editor} */
  #editor(schema, key, label) {
    if (schema.type === 'array') {
      const count = schema.prefixItems?.length ?? 0;
      if (count) return numbers(count, key, label);
      const item = schema.items && resolved(schema.items, this.root);
      const flat = item?.properties && Object.values(item.properties).every((p) => ['number', 'integer', 'string', 'boolean'].includes(resolved(p, this.root).type ?? ''));
      return item && flat ? table(item, this.root, key, label, () => this.#touched()) : json(key);
    }
    if (schema.type === 'object') return json(key);
    return single(schema, key);
  }

  /** Values as the form has them, and what is wrong with those that are none. @returns {{values: Record<string, any>, wrong: {field: string, message: string}[]}} */
  read() {
    /** @type {Record<string, any>} */
    const values = {};
    const wrong = [];
    for (const { path, schema, editor } of this.#fields) {
      try {
        const value = editor.read();
        if (same(value, schema.default)) continue;
        put(values, path.split('.'), value);
      } catch (error) {
        if (!(error instanceof NoValue)) throw error;
        wrong.push({ field: path, message: error.message });
      }
    }
    return { values, wrong };
  }

  /** Fields that are not as by default, in words. */
  changes() {
    return this.#fields.filter(({ row }) => row.classList.contains('changed')).map(({ row, editor }) => {
      const value = told(editor.read());
      return `${row.querySelector('label')?.textContent}${value ? ` ${value}` : ''}`;
    });
  }

  /** Puts values in; what is absent is as by default. @param {Record<string, any>} values */
  write(values) {
    for (const { path, schema, editor } of this.#fields) {
      const given = path.split('.').reduce((/** @type {any} */ part, name) => part?.[name], values);
      editor.write(given === undefined ? schema.default : given);
    }
    this.#mark();
    this.complain([]);
  }

  /** Shows each error at its field. @param {{field: string, message: string}[]} errors @returns {{field: string, message: string}[]} those that belong to no field */
  complain(errors) {
    const homeless = new Set(errors);
    for (const { path, row, error } of this.#fields) {
      const own = errors.filter((e) => e.field === path || e.field.startsWith(`${path}.`));
      for (const one of own) homeless.delete(one);
      const text = own.map((e) => {
        const place = e.field.slice(path.length + 1).split('.').map((part) => (/^\d+$/.test(part) ? `number ${Number(part) + 1}` : words(part))).join(', ');
        return place ? `${capital(place)}: ${e.message}` : e.message;
      }).join('. ');
      setText(error, text);
      error.hidden = !text;
      for (const input of row.querySelectorAll('input, select, textarea')) {
        if (text) input.setAttribute('aria-invalid', 'true');
        else input.removeAttribute('aria-invalid');
        input.setAttribute('aria-describedby', error.id);
      }
    }
    const here = document.activeElement?.closest('.field')?.querySelector('.error:not([hidden])');
    here?.scrollIntoView({ block: 'nearest' });
    return [...homeless];
  }

  /** Goes to the first field that is complained of, or to the first of a path. @param {string} [path] */
  focus(path) {
    const field = path ? this.#fields.find((f) => f.path === path) : this.#fields.find((f) => !f.error.hidden);
    field?.row.scrollIntoView({ block: 'nearest' });
    field?.editor.focus();
  }

  /** Shows only the fields whose words hold all that is asked for. @param {string} text */
  filter(text) {
    const asked = text.toLowerCase().split(/\s+/).filter(Boolean);
    for (const { row, path } of this.#fields) {
      const about = `${path} ${row.textContent}`.toLowerCase();
      row.hidden = !asked.every((word) => about.includes(word));
    }
    for (const group of this.element.querySelectorAll('fieldset')) group.hidden = !group.querySelector('.field:not([hidden])');
  }

  #touched() {
    this.#mark();
    this.changed();
  }

  #mark() {
    for (const { schema, editor, row, reset } of this.#fields) {
      let changed = true;
      try {
        changed = !same(editor.read(), schema.default);
      } catch {
        // What is no value is none of the defaults.
      }
      row.classList.toggle('changed', changed);
      reset.hidden = !changed;
    }
  }
}

/** @param {unknown} a @param {unknown} b */
function same(a, b) {
  return JSON.stringify(a) === JSON.stringify(b);
}

/** @param {unknown} value */
function told(value) {
  if (Array.isArray(value)) return value.every((v) => typeof v === 'number') ? value.join(', ') : '';
  if (typeof value === 'object' && value) return '';
  return value === null || value === undefined ? 'none' : String(value);
}

/** @param {Record<string, any>} into @param {string[]} path @param {unknown} value */
function put(into, path, value) {
  const [first, ...rest] = path;
  if (rest.length) put((into[first] ??= {}), rest, value);
  else into[first] = value;
}

/** One value. @param {Schema} schema @param {string} key @returns {Editor} */
function single(schema, key) {
  const input = control(schema, undefined, { id: key });
  const numeric = schema.type === 'number' || schema.type === 'integer';
  if (schema.default !== null) input.removeAttribute('placeholder');
  return {
    element: input,
    focus: () => input.focus(),
    read: () => {
      if (numeric && input.value.trim() === '' && 'default' in schema && schema.default === null) return null;
      const value = valueOf(schema, input);
      const given = input.value.trim() && `, not “${input.value}”`;
      if (value === undefined || (schema.type === 'integer' && !Number.isInteger(value))) throw new NoValue(`${needed(schema)}${given}.`);
      if (numeric && !within(Number(value), schema)) throw new NoValue(`${input.value} is out of bounds: ${bounds(schema)}.`);
      return value;
    },
    write: (value) => {
      if (input instanceof HTMLInputElement && input.type === 'checkbox') input.checked = value === true;
      else if (schema.enum) input.value = JSON.stringify(value);
      else input.value = value === null || value === undefined ? '' : String(value);
    },
  };
}

/** @param {number} value @param {Schema} schema */
function within(value, schema) {
  return value >= (schema.minimum ?? -Infinity) && value <= (schema.maximum ?? Infinity)
    && value > (schema.exclusiveMinimum ?? -Infinity) && value < (schema.exclusiveMaximum ?? Infinity);
}

/** So many numbers in a row. @param {number} count @param {string} key @param {string} label @returns {Editor} */
function numbers(count, key, label) {
  const inputs = Array.from({ length: count }, (_, i) => h('input', { type: 'text', inputmode: 'decimal', autocomplete: 'off', id: i ? `${key}-${i}` : key, 'aria-label': `${label}, number ${i + 1}` }));
  return {
    element: h('span', { class: 'several' }, ...inputs),
    focus: () => inputs[0].focus(),
    read: () => inputs.map((input, i) => {
      const value = numberIn(input.value);
      if (value === undefined) throw new NoValue(`Number ${i + 1}: a number is needed, not “${input.value}”.`);
      return value;
    }),
    write: (value) => inputs.forEach((input, i) => { input.value = Array.isArray(value) ? String(value[i] ?? '') : ''; }),
  };
}

/** A list of small objects: a row each. @param {Schema} item @param {Schema} root @param {string} key @param {string} label @param {() => void} changed @returns {Editor} */
function table(item, root, key, label, changed) {
  const names = Object.keys(item.properties ?? {});
  const schemas = names.map((name) => resolved(item.properties?.[name] ?? {}, root));
  /** @type {Editor[][]} */
  let rows = [];
  const body = h('tbody', {});
  const draw = () => fill(body, ...rows.map((row, i) => h('tr', {}, ...row.map((editor) => h('td', {}, editor.element)),
    h('td', {}, h('button', { class: 'mini', type: 'button', 'aria-label': `Take out row ${i + 1} of ${label}`, onclick: () => {
      rows.splice(i, 1);
      draw();
      changed();
    } }, '×')))));
  /** @param {Record<string, unknown>} value */
  const add = (value) => {
    rows.push(names.map((name, i) => {
      const editor = single(schemas[i], `${key}-${rows.length}-${name}`);
      editor.element.setAttribute('aria-label', `${label}, row ${rows.length + 1}: ${words(name)}`);
      editor.write(value[name] ?? schemas[i].default);
      return editor;
    }));
  };
  const more = h('button', { class: 'mini', type: 'button', id: key, onclick: () => {
    add({});
    draw();
    changed();
  } }, 'add a row');
  const head = names.map((name, i) => h('th', { scope: 'col', title: [schemas[i].description, bounds(schemas[i])].filter(Boolean).join(' · ') }, `${capital(words(name))}${unitText(schemas[i].unit) ? `, ${unitText(schemas[i].unit)}` : ''}`));
  return {
    element: h('div', { class: 'list' }, h('table', {}, h('thead', {}, h('tr', {}, ...head, h('th', {}))), body), more),
    focus: () => (rows[0]?.[0] ? rows[0][0].focus() : more.focus()),
    read: () => rows.map((row, i) => Object.fromEntries(row.map((editor, j) => {
      try {
        return [names[j], editor.read()];
      } catch (error) {
        throw error instanceof NoValue ? new NoValue(`Row ${i + 1}, ${words(names[j])}: ${error.message}`) : error;
      }
    }))),
    write: (value) => {
      rows = [];
      for (const one of Array.isArray(value) ? value : []) add(one);
      draw();
    },
  };
}

/** What no form fits. @param {string} key @returns {Editor} */
function json(key) {
  const area = h('textarea', { id: key, rows: 3, spellcheck: 'false' });
  return {
    element: area,
    focus: () => area.focus(),
    read: () => {
      try {
        return JSON.parse(area.value);
      } catch {
        throw new NoValue('This is not JSON.');
      }
    },
    write: (value) => { area.value = JSON.stringify(value ?? null, null, 1).replace(/\n\s+(?=[^\s{[\]}])/g, ' ').replace(/\n\s*}/g, ' }'); },
  };
}
