/** All experiments on the server: open one, or make room. */
import { Panel, fill, h } from '../dom.js';
import { commands, read, send } from '../api.js';
import { clock } from '../format.js';
import { refreshRelatives } from '../session.js';
import { store } from '../store.js';
import { attempt, open } from '../actions.js';

export class Experiments extends Panel {
  build() {
    this.list = h('tbody', {});
    this.dialog = h('dialog', { class: 'wide', 'aria-label': 'Experiments' },
      h('header', {}, h('h2', {}, 'Experiments on this server'), h('button', { class: 'mini', onclick: () => attempt(() => this.#clean()) }, 'Delete all but the open one'), h('form', { method: 'dialog' }, h('button', { class: 'mini', 'aria-label': 'Close' }, '×'))),
      h('table', {}, h('thead', {}, h('tr', {}, ...['Title', 'Scenario', 'State', 'Time', ''].map((t) => h('th', { scope: 'col' }, t)))), this.list));
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
    const mine = store.get().experiment?.id;
    if (!this.list) return;
    fill(this.list, ...[...all].reverse().map((one) => h('tr', {},
      h('td', {}, one.title), h('td', {}, one.ghost_of ? 'run without the fault' : one.scenario.title), h('td', {}, one.clock.state), h('td', {}, `${clock(one.clock.time)} of ${clock(one.clock.duration)}`),
      h('td', { class: 'acts' }, one.id === mine ? h('span', { class: 'dim' }, 'open here') : [
        h('button', { class: 'mini', 'aria-label': `Open ${one.title}`, onclick: () => {
          this.dialog?.close();
          void open(one.id);
        } }, 'Open'),
        h('button', { class: 'mini', 'aria-label': `Delete ${one.title}`, onclick: () => attempt(async () => {
          await send(commands.remove(one.id));
          await Promise.all([this.#draw(), refreshRelatives()]);
        }) }, 'Delete')]))), !all.length && h('tr', {}, h('td', { colspan: 5 }, 'None.')));
  }
}

customElements.define('ft-experiments', Experiments);
