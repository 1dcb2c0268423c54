/** The keyboard: everything that matters has a key, and `?` lists them. */
import { Panel, h } from '../dom.js';
import { SPEEDS } from '../session.js';
import { period, store } from '../store.js';
import { back, branch, clearAll, look, openDialog, rewind, setSpeed, setTheme, shareLink, step, toggleChart, toggleGhost, toggleUnlessOver, zoomTo } from '../actions.js';

/** @type {{keys: string[], what: string, act: (event: KeyboardEvent) => unknown}[]} */
const KEYS = [
  { keys: [' '], what: 'run or pause', act: toggleUnlessOver },
  { keys: ['ArrowRight'], what: 'one epoch on: fly it when live, look at it when scrubbed back (Shift: ten)', act: (e) => move(e.shiftKey ? 10 : 1) },
  { keys: ['ArrowLeft'], what: 'look one epoch back (Shift: ten)', act: (e) => move(e.shiftKey ? -10 : -1) },
  { keys: ['[', ']'], what: 'rewind by one epoch, fly one epoch', act: (e) => (e.key === '[' ? back() : step()) },
  { keys: ['Home', 'End'], what: 'look at the start, back to live', act: (e) => look(e.key === 'Home' ? 0 : null) },
  { keys: ['Escape'], what: 'close what is open, then back to live', act: () => look(null) },
  { keys: ['+', '-'], what: 'faster, slower', act: (e) => faster(e.key === '-' ? -1 : 1) },
  { keys: ['f'], what: 'fault form', act: () => /** @type {(HTMLElement & {focusForm(): void}) | null} */ (document.querySelector('ft-bench'))?.focusForm() },
  { keys: ['c'], what: 'clear all faults', act: clearAll },
  { keys: ['r'], what: 'rewind to the moment looked at', act: () => cursor(rewind) },
  { keys: ['b'], what: 'branch from the moment looked at, or from now', act: () => branch(store.get().cursor ?? store.get().now) },
  { keys: ['g'], what: 'the run without the fault, behind this one', act: toggleGhost },
  { keys: ['1', '2', '3', '4', '5', '6', '7', '8', '9'], what: 'show or hide a chart, in the order of the chooser', act: (e) => chart(Number(e.key)) },
  { keys: ['0'], what: 'zoom out to the whole flight', act: () => zoomTo(null) },
  { keys: ['l'], what: 'filter the log', act: () => /** @type {HTMLElement | null} */ (document.querySelector('ft-log input'))?.focus() },
  { keys: ['p'], what: 'parameters, for a new experiment', act: () => openDialog('ft-parameters') },
  { keys: ['o'], what: 'open a receiver log', act: () => openDialog('ft-receiver') },
  { keys: ['v'], what: 'the scene at full size, and back', act: () => store.set(({ large }) => ({ large: !large })) },
  { keys: ['s'], what: 'copy a link that restores this run', act: shareLink },
  { keys: ['t'], what: 'dark or light', act: () => setTheme(store.get().theme === 'dark' ? 'light' : 'dark') },
  { keys: ['?'], what: 'these keys', act: () => openDialog('ft-keys') },
];

/** @type {Record<string, string>} */
const NAMES = { ' ': 'space', ArrowRight: '→', ArrowLeft: '←', Escape: 'Esc' };

export class Keys extends Panel {
  build() {
    this.dialog = h('dialog', { 'aria-label': 'Keys' }, h('header', {}, h('h2', {}, 'Keys'), h('form', { method: 'dialog' }, h('button', { class: 'mini', 'aria-label': 'Close' }, '×'))),
      h('dl', { class: 'keys' }, ...KEYS.flatMap(({ keys, what }) => [
        h('dt', {}, ...(keys.length > 3 ? [h('kbd', {}, keys[0]), ' … ', h('kbd', {}, keys[keys.length - 1])] : keys.map((key) => h('kbd', {}, NAMES[key] ?? key)))), h('dd', {}, what)])),
      h('p', { class: 'dim' }, 'In the charts: drag to zoom all of them, double click to zoom out, click to look at a moment, Ctrl and wheel to zoom.'));
    this.append(this.dialog);
    const listen = (/** @type {KeyboardEvent} */ event) => press(event);
    document.addEventListener('keydown', listen);
    this.keep(() => document.removeEventListener('keydown', listen));
  }

  open() {
    this.dialog?.showModal();
  }
}

/** Keys that may be held down. */
const REPEATED = ['ArrowRight', 'ArrowLeft', '[', ']', '+', '-', '='];

/** Closes what lies over the page, the uppermost first. @returns {boolean} whether something did */
function shut() {
  const menu = /** @type {HTMLElement | null} */ ([...document.querySelectorAll(':popover-open')].at(-1) ?? null);
  if (menu) {
    menu.hidePopover();
    return true;
  }
  const { large, welcome, now } = store.get();
  if (large) store.set({ large: false });
  else if (welcome && now === 0) store.set({ welcome: false });
  else return false;
  return true;
}

/** @param {KeyboardEvent} event */
export function press(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented) return;
  const target = event.target instanceof Element ? event.target : null;
  if (document.querySelector('dialog[open]')) return;
  if (event.key === 'Escape' && shut()) return event.preventDefault();
  if (target?.closest('[popover]')) return;
  // Held down, a key that looks or flies on repeats; one that does something does it once.
  if (event.repeat && !REPEATED.includes(event.key)) return;
  if (target?.closest('input:not([type=checkbox]), select, textarea')) {
    if (event.key === 'Escape') /** @type {HTMLElement} */ (target).blur();
    return;
  }
  if (event.key === ' ' && target?.closest('button, a, input, [role=button]')) return;
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  const found = KEYS.find(({ keys }) => keys.includes(key === '=' ? '+' : key));
  if (!found) return;
  if (key.startsWith('Arrow') && target?.closest('.events')) return;
  event.preventDefault();
  found.act(event);
}

/** @param {number} epochs */
function move(epochs) {
  const { cursor: at, now } = store.get();
  if (at === null && epochs > 0) return step();
  return look((at ?? now) + epochs * period());
}

/** @param {(time: number) => unknown} act */
function cursor(act) {
  const { cursor: at } = store.get();
  if (at !== null) act(at);
}

/** @param {number} direction */
function faster(direction) {
  const speed = store.get().experiment?.clock.speed;
  const place = speed === 'max' ? SPEEDS.length : SPEEDS.findIndex((s) => s >= Number(speed));
  const next = place + direction;
  if (next >= SPEEDS.length) return setSpeed('max');
  return setSpeed(SPEEDS[Math.max(0, next)]);
}

/** @param {number} number */
function chart(number) {
  const one = store.get().description?.charts[number - 1];
  if (one) toggleChart(one.id);
}

customElements.define('ft-keys', Keys);
