/** All experiments on the server: open one, or make room. */
import { Panel, fill, h, setText } from '../dom.js';
import { commands, read, send } from '../api.js';
import { isMine } from '../mine.js';
import { sure } from './confirm.js';
import { clock } from '../format.js';
import { refreshRelatives } from '../session.js';
import { store } from '../store.js';
import { attempt, open } from '../actions.js';
/** @import {Experiment} from '../types' */

export const COLUMNS = ['Title', 'Scenario', 'State', 'Time', 'Made', 'Watched by', ''];

export class Experiments extends Panel {
  build() {
    this.list = h('tbody', {});
    this.said = h('p', { class: 'said', role: 'status', hidden: true });
    this.dialog = h('dialog', { class: 'wide', 'aria-label': 'Experiments' },
      h('header', {}, h('h2', {}, 'Experiments on this server'), h('button', { class: 'mini', 'data-once': true, onclick: () => attempt(() => this.#clean()) }, 'Delete mine but the open one …'), h('form', { method: 'dialog' }, h('button', { class: 'mini', 'aria-label': 'Close' }, '×'))),
      this.said, h('div', { class: 'sheet' }, h('table', {}, h('thead', {}, h('tr', {}, ...COLUMNS.map((t) => h('th', { scope: 'col' }, t)))), this.list)));
    this.append(this.dialog);
  }

  /** Says something inside the dialog: whatever lies outside of it is out of reach. @param {string} text */
  #say(text) {
    if (!this.said) return;
    setText(this.said, text);
    this.said.hidden = !text;
  }

  open() {
    this.#say('');
    this.dialog?.showModal();
    void attempt(() => this.#draw());
  }

  async #clean() {
    const here = store.get().experiment?.id;
    const others = (await read.experiments()).filter((one) => one.id !== here);
    const own = others.filter((one) => isMine(one.id) && !one.watchers);
    const watched = others.filter((one) => isMine(one.id) && one.watchers);
    const strange = others.filter((one) => !isMine(one.id));
    const stay = [
      watched.length && `${counted(watched.length, 'of its own')} ${watched.length > 1 ? 'are' : 'is'} watched now and ${watched.length > 1 ? 'stay' : 'stays'}.`,
      strange.length && `${counted(strange.length, 'made elsewhere')} ${strange.length > 1 ? 'stay' : 'stays'}: ${strange.length > 1 ? 'they are' : 'it is'} not this browser’s to delete.`,
    ].filter((text) => typeof text === 'string');
    this.#say(own.length ? '' : ['There is nothing here that this browser made, but the open one.', ...stay].join(' '));
    if (!own.length) return;
    const title = `Delete ${counted(own.length, 'that this browser made')}?`;
    if (!(await sure(title, [...stay, 'The open one stays. What is deleted cannot be brought back.'], `Delete ${own.length}`))) return;
    for (const one of own) await send(commands.remove(one.id));
    await Promise.all([this.#draw(), refreshRelatives()]);
  }

  async #draw() {
    const all = await read.experiments();
    if (!this.list) return;
    fill(this.list, ...rows(all, () => this.dialog?.close(), () => Promise.all([this.#draw(), refreshRelatives()])),
      !all.length && h('tr', {}, h('td', { colspan: COLUMNS.length }, 'None.')));
  }
}

/** @param {number} count @param {string} which */
function counted(count, which) {
  return `${count} ${count > 1 ? 'experiments' : 'experiment'} ${which}`;
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
    h('td', {}, isMine(one.id) ? 'here' : 'elsewhere'), h('td', {}, one.id === mine ? '' : one.watchers ? 'someone' : 'nobody'),
    h('td', { class: 'acts' }, one.id === mine ? h('span', { class: 'dim' }, 'open here') : [
      h('button', { class: 'mini', 'aria-label': `Open ${one.title}`, onclick: () => {
        opening();
        void open(one.id);
      } }, 'Open'),
      h('button', { class: 'mini', 'data-once': true, 'aria-label': `Delete ${one.title}`, onclick: () => attempt(async () => {
        const theirs = [!isMine(one.id) && 'It was not made by this browser.', one.watchers && 'Someone watches it now.'].filter((text) => typeof text === 'string');
        if (theirs.length && !(await sure(`Delete “${one.title}”?`, [...theirs, 'It cannot be brought back.'], 'Delete it'))) return;
        await send(commands.remove(one.id));
        await deleted();
      }) }, 'Delete')])));
}

customElements.define('ft-experiments', Experiments);
