/** What the person must know: lost connection, failures, refusals; and fault events said aloud. */
import { Panel, fill, h } from '../dom.js';
import { happened } from '../session.js';
import { clock } from '../format.js';
import { reason, sentence } from '../marks.js';
import { period, store } from '../store.js';
import { branch, fly, openDialog, rewind, run, say } from '../actions.js';
/** @import {Event, Notice} from '../types' */

const SHORT = 4200;
const MOST = 4;
const SPOKEN = ['fault.injected', 'fault.started', 'fault.cleared', 'fault.ended', 'subsystem.isolated', 'subsystem.readmitted'];

export class Notices extends Panel {
  build() {
    this.setAttribute('role', 'status');
    this.watch((s) => [s.connection, s.busy, s.experiment?.clock.state, s.experiment?.clock.reason], () => this.#banner());
    this.watch((s) => s.notice, (notice) => notice && toast(notice));
    happened.addEventListener('event', (event) => announce(/** @type {CustomEvent<Event>} */ (event).detail));
  }

  #banner() {
    const { connection, busy, experiment } = store.get();
    const clockState = experiment?.clock;
    const ready = store.get().scenarios.find((s) => s.id === experiment?.scenario.id);
    this.className = '';
    if (connection === 'lost') {
      this.#tell('warning', 'Connection lost. The page keeps what it has and resumes by itself.');
    } else if (connection === 'gone') {
      this.#tell('error', 'This experiment is no longer on the server.',
        ready && h('button', { 'data-once': true, onclick: () => fly(ready.id) }, 'Fly its scenario again'), h('button', { onclick: () => openDialog('ft-experiments') }, 'Other experiments'));
    } else if (clockState?.state === 'failed') {
      this.#tell('error', `The experiment has failed: ${clockState.reason ?? 'the server does not say why'}.`,
        h('button', { onclick: () => rewind(Math.max(0, store.get().now - Math.max(1, period()))) }, 'Rewind a little'), h('button', { 'data-once': true, onclick: () => branch(0) }, 'Start over in a branch'));
    } else if (clockState?.state === 'paused' && clockState.reason) {
      this.#tell('warning', `Paused at ${clock(clockState.time, 1)}: ${clockState.reason}.`, h('button', { onclick: run }, 'Go on'));
    } else if (busy) this.#tell('info', busy);
    else this.replaceChildren();
  }

  /** @param {string} tone @param {string} text @param {...(HTMLElement | undefined)} acts */
  #tell(tone, text, ...acts) {
    this.className = tone;
    fill(this, h('span', {}, text), ...acts);
  }
}

/** @param {Notice} notice */
function toast(notice) {
  const room = document.getElementById('toasts');
  if (!room) return;
  // What went wrong, or is not as asked for, stays until it has been read.
  const lasting = notice.tone !== 'info' || notice.sticky;
  const one = h('div', { class: `toast ${notice.tone}`, role: notice.tone === 'error' ? 'alert' : 'status' }, h('span', { class: notice.verbatim ? 'selectable' : '' }, notice.text),
    notice.action && h('button', { onclick: () => {
      notice.action?.run();
      one.remove();
    } }, notice.action.label),
    h('button', { class: 'mini', 'aria-label': 'Dismiss', onclick: () => one.remove() }, '×'));
  room.append(one);
  if (!lasting) {
    one.classList.add('passing');
    setTimeout(() => one.remove(), SHORT);
  }
  while (room.children.length > MOST) (room.querySelector('.passing') ?? room.firstElementChild)?.remove();
  say(null);
}

/** Fault events only, politely; nothing else is worth interrupting for. @param {Event} event */
function announce(event) {
  const place = document.getElementById('announcer');
  if (!place || !SPOKEN.includes(event.kind) || event.run > 0) return;
  const { description } = store.get();
  const why = reason(event, description);
  place.append(h('p', {}, `${clock(event.time, 1)}: ${sentence(event, description)}${why ? `, ${why}` : ''}`));
  while (place.children.length > 5) place.firstElementChild?.remove();
}

customElements.define('ft-notices', Notices);
