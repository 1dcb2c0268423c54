/**
 * JSON Schema to form controls: what a system declares can be set, and how.
 * @import {Schema} from './types'
 */
import { h } from './dom.js';
import { capital, words } from './format.js';

/**
 * The schema itself, with references followed and "or null" taken off.
 * @param {Schema} schema
 * @param {Schema} root
 * @returns {Schema}
 */
export function resolved(schema, root) {
  if (schema.$ref) {
    const target = root.$defs?.[schema.$ref.split('/').at(-1) ?? ''] ?? {};
    const { $ref: _, ...rest } = schema;
    return { ...resolved(target, root), ...rest };
  }
  const some = schema.anyOf?.filter((s) => s.type !== 'null') ?? schema.allOf;
  if (some?.length === 1) {
    const { anyOf: _a, allOf: _b, ...rest } = schema;
    return { ...resolved(some[0], root), ...rest };
  }
  return schema;
}

/** The title that was given to a field, else its name; a schema without one has `gps_share` as "Gps Share". @param {string} name @param {Schema} schema */
export function fieldLabel(name, schema) {
  const made = words(name).replace(/(^| )[a-z]/g, (letter) => letter.toUpperCase());
  return schema.title && schema.title !== made ? schema.title : capital(words(name));
}

/**
 * A control for one property: choice, switch or number.
 * @param {Schema} schema resolved
 * @param {unknown} value
 * @param {{id: string, describedby?: string}} attributes
 * @returns {HTMLInputElement | HTMLSelectElement}
 */
export function control(schema, value, attributes) {
  const common = { id: attributes.id, 'aria-describedby': attributes.describedby };
  if (schema.enum) {
    return h('select', common, ...schema.enum.map((option) => h('option', { value: JSON.stringify(option), selected: option === value }, words(String(option)))));
  }
  if (schema.type === 'boolean') return h('input', { ...common, type: 'checkbox', checked: value === true });
  if (schema.type === 'number' || schema.type === 'integer') {
    return h('input', {
      ...common, ...(isTime(schema) ? { type: 'text', autocomplete: 'off' } : { type: 'number', step: schema.type === 'integer' ? 1 : 'any', min: schema.minimum ?? null, max: schema.maximum ?? null }),
      inputmode: 'decimal', value: value ?? '', placeholder: value === null || value === undefined ? 'none' : null,
    });
  }
  return h('input', { ...common, type: 'text', value: value ?? '' });
}

/**
 * What the control holds now, ready for JSON; undefined where it holds no number.
 * @param {Schema} schema resolved
 * @param {HTMLInputElement | HTMLSelectElement} element
 * @returns {unknown}
 */
export function valueOf(schema, element) {
  if (schema.enum) return JSON.parse(element.value);
  if (element instanceof HTMLInputElement && element.type === 'checkbox') return element.checked;
  if (schema.type === 'number' || schema.type === 'integer') return isTime(schema) ? timeIn(element.value) : numberIn(element.value);
  return element.value;
}

/** Seconds in a text: 150, 2:30 or 1:02:03.5. @param {string} text @returns {number | undefined} */
export function timeIn(text) {
  const parts = text.trim().replace(',', '.').split(':');
  if (parts.length === 1) return numberIn(text);
  if (parts.length > 3 || !parts.every((part, i) => (i === parts.length - 1 ? /^[0-5]?\d([.]\d*)?$/ : i ? /^[0-5]?\d$/ : /^\d+$/).test(part))) return undefined;
  return parts.reduce((sum, part) => 60 * sum + Number(part), 0);
}

/** What is needed where there is no number, or none that fits. @param {Schema} schema resolved */
export function needed(schema) {
  const limits = bounds(schema);
  const what = isTime(schema) ? 'A time is needed: seconds (150) or minutes and seconds (2:30)' : schema.type === 'integer' ? 'A whole number is needed' : 'A number is needed';
  return `${what}${limits ? `, ${limits}` : ''}`;
}

/** Whether a schema is one of a time or a stretch of time, which may be typed as 2:30. @param {Schema} schema resolved */
export function isTime(schema) {
  return schema.unit === 's' && (schema.type === 'number' || schema.type === 'integer');
}

/** @param {string} text @returns {number | undefined} */
export function numberIn(text) {
  const trimmed = text.trim().replace('−', '-').replace(',', '.');
  const value = Number(trimmed);
  return trimmed === '' || Number.isNaN(value) ? undefined : value;
}

/** @param {Schema} schema resolved @param {HTMLInputElement | HTMLSelectElement} element @param {unknown} value */
export function show(schema, element, value) {
  if (document.activeElement === element && !schema.enum && schema.type !== 'boolean') return;
  if (schema.enum) element.value = JSON.stringify(value);
  else if (element instanceof HTMLInputElement && element.type === 'checkbox') element.checked = value === true;
  else element.value = value === null || value === undefined ? '' : String(value);
}

/** Bounds in words, for the hint beside a field. @param {Schema} schema resolved */
export function bounds(schema) {
  const low = schema.minimum ?? schema.exclusiveMinimum;
  const high = schema.maximum ?? schema.exclusiveMaximum;
  if (low !== undefined && high !== undefined) return `${low} to ${high}`;
  if (low !== undefined) return schema.minimum === undefined ? `more than ${low}` : `at least ${low}`;
  return high === undefined ? '' : `at most ${high}`;
}
