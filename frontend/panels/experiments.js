/** All experiments on the server: open one, or make room. */
import { Panel, fill, h } from '../dom.js';
import { commands, read, send } from '../api.js';
import { clock } from '../format.js';
import { refreshRelatives } from '../session.js';
import { store } from '../store.js';
import { attempt, open } from '../actions.js';
/** @import {Experiment} from '../types' */

export const COLUMNS = ['Title', 'Scenario', 'State', 'Time', 'Watched by', ''];

export class Experiments extends Panel {
  build() {
    this.list = h('tbody', {});
    this.dialog = h('dialog', { class: 'wide', 'aria-label': 'Experiments' },
      h('header', {}, h('h2', {}, 'Experiments on this server'), h('button', { class: 'mini', onclick: () => attempt(() => this.#clean()) }, 'Delete all but the open one'), h('form', { method: 'dialog' }, h('button', { class: 'mini', 'aria-label': 'Close' }, '×'))),
      h('table', {}, h('thead', {}, h('tr', {}, ...COLUMNS.map((t) => h('th', { scope: 'col' }, t)))), this.list));
    this.append(this.dialog);
  }

  open() {
    this.dialog?.showModal();
    void attempt(() => this.#draw());
  }

  async #clean() {
    const mine = store.get().experiment?.id;
    for (const one of await read.experiments()) if (one.id !== mine) await send(commands.remove(one.id));
    await Promise.all([this.#draw(), refreshRelatives()]);
  }

  async #draw() {
    const all = await read.experiments();
    if (!this.list) return;
    fill(this.list, ...rows(all, () => this.dialog?.close(), () => Promise.all([this.#draw(), refreshRelatives()])),
      !all.length && h('tr', {}, h('td', { colspan: COLUMNS.length }, 'None.')));
  }
}

/**
 * One row an experiment, newest first, with what can be done to it.
 * @param {Experiment[]} all
 * @param {() => void} opening before one is opened
 * @param {() => Promise<unknown>} deleted after one is deleted
 */
export function rows(all, opening, deleted) {
  const mine = store.get().experiment?.id;
  return [...all].reverse().map((one) => h('tr', {},
    h('td', {}, one.title), h('td', {}, one.ghost_of ? 'run without the fault' : one.scenario.title), h('td', {}, one.clock.state), h('td', {}, `${clock(one.clock.time)} of ${clock(one.clock.duration)}`),
    h('td', {}, one.id === mine ? '' : one.watchers ? 'someone' : 'nobody'),
    h('td', { class: 'acts' }, one.id === mine ? h('span', { class: 'dim' }, 'open here') : [
      h('button', { class: 'mini', 'aria-label': `Open ${one.title}`, onclick: () => {
        opening();
        void open(one.id);
      } }, 'Open'),
      h('button', { class: 'mini', 'aria-label': `Delete ${one.title}`, onclick: () => attempt(async () => {
        await send(commands.remove(one.id));
        await deleted();
      }) }, 'Delete')])));
}

customElements.define('ft-experiments', Experiments);
