/** The top bar: what flies, the clock, branches, and what can be taken away. */
import { Panel, fill, h, setText } from '../dom.js';
import { clock, decimalsOf, words } from '../format.js';
import { told } from '../pace.js';
import { SPEEDS } from '../session.js';
import { period, store } from '../store.js';
import { back, branch, fly, open, openDialog, setSpeed, setTheme, shareLink, step, toggle } from '../actions.js';
import { exportMenu } from './export.js';
/** @import {Experiment} from '../types' */

/** No scenario has this id. */
const OWN_LOG = '+log';

export class TopBar extends Panel {
  build() {
    this.append(
      h('b', { class: 'brand' }, 'FTLab'), this.#scenarios(), this.#branches(), h('span', { class: 'space' }),
      this.#clock(), h('span', { class: 'space' }),
      h('button', { class: 'branch', 'data-once': true, 'aria-label': 'Branch from here', title: 'Go on from this moment in a copy; this run stays as it is (b)', onclick: () => branch(store.get().cursor ?? store.get().now) }, 'Branch', h('span', { class: 'wordy' }, ' from here')),
      h('button', { class: 'ghost', title: 'Copy a link that restores this run (s)', onclick: shareLink }, 'Share'),
      exportMenu(), this.#theme(),
      h('button', { class: 'ghost', title: 'What the page asks of the server, as curl', onclick: () => openDialog('ft-rest') }, 'REST'),
      h('button', { class: 'ghost', 'aria-label': 'Keys', title: 'Keys (?)', onclick: () => openDialog('ft-keys') }, '?'),
    );
  }

  #scenarios() {
    const select = h('select', { class: 'scenario', 'aria-label': 'Scenario', onchange: () => {
      const chosen = select.value;
      const back = () => { select.value = store.get().experiment?.scenario.id ?? ''; };
      if (chosen !== OWN_LOG) return void fly(chosen).then(back);
      back();
      openDialog('ft-receiver');
    } });
    this.watch((s) => [s.scenarios, s.experiment?.scenario.id, s.experiment?.scenario.title], () => {
      const { scenarios, experiment } = store.get();
      const current = experiment?.scenario;
      const strange = current && !scenarios.some((s) => s.id === current.id);
      const systems = [...new Set(scenarios.map((s) => s.system))];
      fill(select, !current && h('option', { value: '', disabled: true, selected: true }, 'Choose a scenario'), strange && h('option', { value: current.id }, current.title), ...systems.map((system) =>
        h('optgroup', { label: words(system) }, ...scenarios.filter((s) => s.system === system).map((s) => h('option', { value: s.id, title: s.summary }, s.title)))),
        h('optgroup', { label: 'your own' }, h('option', { value: OWN_LOG }, 'Open a receiver log …')));
      if (current) select.value = current.id;
      document.title = current ? `${current.title} – FTLab` : 'FTLab';
      select.title = scenarios.find((s) => s.id === current?.id)?.summary ?? '';
    });
    return select;
  }

  #branches() {
    const select = h('select', { class: 'branches ghost', 'aria-label': 'Branch', onchange: () => {
      if (select.value === 'all') {
        select.value = store.get().experiment?.id ?? '';
        openDialog('ft-experiments');
      } else void open(select.value);
    } });
    this.watch((s) => [s.relatives, s.experiment?.id, s.experiment?.title], () => {
      const { relatives, experiment } = store.get();
      const list = relatives.length || !experiment ? relatives : [experiment];
      fill(select, ...tree(list).map(({ one, depth }) => h('option', { value: one.id }, `${'  '.repeat(depth)}${depth ? '└ ' : ''}${depth || one.title !== one.scenario.title ? one.title : 'Main run'}`)),
        h('option', { value: 'all' }, 'All experiments …'));
      if (experiment) select.value = experiment.id;
    });
    return select;
  }

  #clock() {
    const play = h('button', { class: 'primary play', title: 'Run or pause (space)', onclick: toggle }, 'Run');
    const speed = h('select', { 'aria-label': 'Speed', title: 'Speed (+ and -)', onchange: () => setSpeed(speed.value === 'max' ? 'max' : Number(speed.value)) },
      ...SPEEDS.map((s) => h('option', { value: s }, `${s}x`)), h('option', { value: 'max' }, 'max'));
    const time = h('span', { class: 'time' });
    const of = h('span', { class: 'of' });
    const flying = h('span', { class: 'flying', title: 'The machine does not hold the speed that was asked for, or none was: this is what it flies' });
    this.watch((s) => told(s.experiment?.clock.speed, s.rate), (text) => setText(flying, text));
    this.watch((s) => [s.experiment?.clock.state, s.experiment?.id], () => {
      const state = store.get().experiment?.clock.state;
      play.textContent = state === 'running' || state === 'advancing' ? 'Pause' : state === 'finished' ? 'Run again' : 'Run';
      play.title = state === 'finished' ? 'Back to the start, and fly again (space)' : 'Run or pause (space)';
      play.disabled = !state || state === 'failed';
    });
    this.watch((s) => s.experiment?.clock.speed, (value) => {
      if (value === undefined) return;
      if (![...speed.options].some((o) => o.value === String(value))) speed.prepend(h('option', { value }, `${value}x`));
      speed.value = String(value);
    });
    this.watch((s) => [s.now, period(s), s.experiment?.clock.duration, s.cursor === null], () => {
      const { now, experiment, cursor } = store.get();
      setText(time, clock(now, Math.max(1, decimalsOf(period()))));
      setText(of, !experiment ? '' : cursor === null ? `of ${clock(experiment.clock.duration)}` : 'is now');
    });
    return h('div', { class: 'clock', role: 'group', 'aria-label': 'Clock' },
      h('button', { 'aria-label': 'Back one epoch', title: 'Rewind by one epoch ( [ )', onclick: back }, '|‹'), play,
      h('button', { 'aria-label': 'Forward one epoch', title: 'Forward one epoch ( ] )', onclick: step }, '›|'), speed,
      h('span', { class: 'times' }, h('span', {}, time, ' ', of), flying));
  }

  #theme() {
    const button = h('button', { class: 'ghost', title: 'Theme (t)', onclick: () => setTheme(store.get().theme === 'dark' ? 'light' : 'dark') });
    this.watch((s) => s.theme, (theme) => {
      button.textContent = theme === 'dark' ? '☾' : '☀';
      button.setAttribute('aria-label', `Theme: ${theme}. Change it`);
    });
    return button;
  }
}

/** Parents before children, with depth. @param {Experiment[]} list */
function tree(list) {
  /** @type {{one: Experiment, depth: number}[]} */
  const result = [];
  const ids = new Set(list.map((e) => e.id));
  /** @param {string | null} parent @param {number} depth */
  const walk = (parent, depth) => {
    for (const one of list) {
      if ((one.parent && ids.has(one.parent) ? one.parent : null) !== parent) continue;
      result.push({ one, depth });
      walk(one.id, depth + 1);
    }
  };
  walk(null, 0);
  return result;
}

customElements.define('ft-topbar', TopBar);
