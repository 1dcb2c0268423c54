/** The numbers behind a chart, as a table that can be read aloud, copied and kept. */
import { Panel, fill, h } from '../dom.js';
import { file, seriesPath } from '../api.js';
import { clock, decimalsOf, unitText } from '../format.js';
import { searchAfter } from '../recording.js';
import { recording } from '../session.js';
import { period, store } from '../store.js';
import { attempt, id, look } from '../actions.js';
import { download } from './export.js';
/** @import {Chart} from '../types' */

const MOST = 500;

export class TablePanel extends Panel {
  build() {
    this.dialog = h('dialog', { class: 'table', 'aria-label': 'Table' });
    this.append(this.dialog);
  }

  /** Numbers of a moment. @param {Chart} chart @param {import('../moments.js').Sheet} sheet @param {string[]} signals behind them */
  show(chart, sheet, signals) {
    this.#fill(chart, signals, sheet.caption, sheet.head, sheet.rows.map(([first, ...rest]) => h('tr', {}, h('th', { scope: 'row' }, first), ...rest.map((value) => h('td', {}, value)))));
    this.dialog?.querySelector('tbody tr:last-child')?.scrollIntoView({ block: 'nearest' });
  }

  /** Numbers over time. @param {Chart} chart @param {[number, number]} range what the charts show [s] */
  open(chart, range) {
    const { description, now, cursor } = store.get();
    const from = searchAfter(recording.time, range[0] - 1e-9);
    const to = searchAfter(recording.time, range[1] + 1e-9);
    const stride = Math.max(1, Math.ceil((to - from) / MOST));
    const told = chart.traces.filter((t) => recording.has(t.signal));
    const columns = (told.length ? told : chart.traces).flatMap((t) => [{ name: t.signal, label: t.label }, ...(t.sigma ? [{ name: t.sigma, label: `${t.label} 1σ` }] : [])]);
    const factors = new Map(description?.signals.map((s) => [s.name, s.factor]));
    const shown = columns.map(({ name }) => {
      const values = (recording.column(name) ?? new Float64Array(to)).map((v) => v / (factors.get(name) ?? 1));
      return { values, places: placesOf(values.subarray(from, to)) };
    });
    const decimals = decimalsOf(period());
    const unit = unitText(chart.unit);
    /** @type {HTMLTableRowElement[]} */
    const rows = [];
    for (let i = from; i < to; i += stride) {
      rows.push(h('tr', {}, h('th', { scope: 'row' }, clock(recording.time[i], decimals)),
        ...shown.map(({ values, places }) => h('td', {}, fixed(values[i], places)))));
    }
    const caption = `${rows.length} of ${to - from} epochs from ${clock(range[0])} to ${clock(Math.min(range[1], now))}${stride > 1 ? `, every ${stride}th` : ''}${unit ? `; values in ${unit}` : ''}`;
    this.#fill(chart, columns.map((c) => c.name), caption, ['time', ...columns.map((c) => c.label)], rows);
    const at = cursor ?? now;
    const row = Math.min(rows.length - 1, Math.max(0, Math.round((recording.index(at) - from) / stride)));
    rows[row]?.scrollIntoView({ block: 'center' });
    rows[row]?.classList.add('at');
    this.dialog?.querySelector('tbody')?.addEventListener('click', (event) => {
      const line = event.target instanceof Element ? event.target.closest('tr') : null;
      if (line) look(recording.time[from + rows.indexOf(line) * stride]);
    });
  }

  /** @param {Chart} chart @param {string[]} signals @param {string} caption @param {string[]} head @param {HTMLTableRowElement[]} rows */
  #fill(chart, signals, caption, head, rows) {
    const keep = () => attempt(async () => download(await file(seriesPath(id(), signals), 'text/csv'), `ftlab-${chart.id}.csv`));
    fill(this.dialog ?? this,
      h('header', {}, h('h2', {}, chart.title), h('button', { class: 'mini', onclick: keep }, 'CSV (SI)'),
        h('form', { method: 'dialog' }, h('button', { class: 'mini', 'aria-label': 'Close' }, '×'))),
      h('div', { class: 'sheet', tabindex: 0, role: 'region', 'aria-label': 'Numbers' },
        h('table', {}, h('caption', {}, caption), h('thead', {}, h('tr', {}, ...head.map((text) => h('th', { scope: 'col' }, text)))), h('tbody', {}, ...rows))));
    this.dialog?.showModal();
  }
}

/** Decimals that give the greatest value of a column four digits. @param {Float64Array} values */
function placesOf(values) {
  const greatest = values.reduce((most, v) => (Math.abs(v) > most ? Math.abs(v) : most), 0);
  return greatest > 0 ? Math.min(9, Math.max(0, 3 - Math.floor(Math.log10(greatest)))) : 0;
}

/** @param {number} value @param {number} places */
function fixed(value, places) {
  return Number.isFinite(value) ? value.toFixed(places).replace('-', '−') : '–';
}

customElements.define('ft-table', TablePanel);
