/** Everything a person can do. Refusals become a notice, except where a form shows them at the field. */
import { Problem, commands, curl, moveScene, read, send } from './api.js';
import * as ghost from './ghost.js';
import * as session from './session.js';
import { claim } from './mine.js';
import { single } from './once.js';
import { link } from './share.js';
import { period, store } from './store.js';
/** @import {Notice} from './types' */

/** @param {Notice | null} notice */
export function say(notice) {
  store.set({ notice });
}

/**
 * Does something that may be refused, and tells why it was.
 * @template T
 * @param {() => Promise<T>} act
 * @returns {Promise<T | undefined>}
 */
export async function attempt(act) {
  try {
    return await act();
  } catch (error) {
    if (!(error instanceof Error)) throw error;
    say({ tone: 'error', text: error.message, action: wayOut(error) });
    return undefined;
  }
}

/** What helps against a refusal, where something does. @param {Error} error @returns {Notice['action']} */
function wayOut(error) {
  const status = error instanceof Problem ? error.status : 0;
  if (status === 429) return { label: 'Choose experiments to delete', run: () => openDialog('ft-experiments') };
  if (status === 401) return { label: 'Give the token', run: () => location.assign('/login') };
  return undefined;
}

/** @param {string} tag a panel that is a dialog */
export function openDialog(tag) {
  /** @type {(HTMLElement & {open(): void}) | null} */ (document.querySelector(tag))?.open();
}

/** Id of the experiment on the page. */
export function id() {
  return store.get().experiment?.id ?? '';
}

export const clockState = () => store.get().experiment?.clock.state ?? 'paused';

export const run = () =>
  attempt(async () => {
    const { experiment } = store.get();
    if (!experiment) return;
    if (experiment.clock.state === 'finished') await send(commands.rewind(experiment.id, 0));
    store.set({ welcome: false });
    await send(commands.clock(experiment.id, { state: 'running' }));
  });

export const pause = () => attempt(() => send(commands.clock(id(), { state: 'paused' })));

/** Whether time goes by: by the clock, or by an advance that someone asked for. */
export const flies = () => ['running', 'advancing'].includes(clockState());

export const toggle = () => (flies() ? pause() : run());

/** As toggle, for a key that is pressed without looking: a flight that is over is not flown anew by accident. */
export const toggleUnlessOver = () => {
  if (clockState() !== 'finished') return toggle();
  say({ tone: 'info', text: 'The flight is over. Look back with the arrows, rewind, branch,', action: { label: 'or run it again', run } });
  return Promise.resolve();
};

/** @param {number | 'max'} speed */
export const setSpeed = (speed) => attempt(() => send(commands.clock(id(), { speed })));

export const step = () =>
  attempt(async () => {
    if (flies()) await pause();
    store.set({ welcome: false });
    await send(commands.advance(id(), { epochs: 1 }));
  });

/** @param {number} time */
export const rewind = (time) =>
  attempt(async () => {
    await send(commands.rewind(id(), time));
    look(null);
  });

export const back = () => {
  const { experiment, now } = store.get();
  if (experiment && now > 0) return rewind(Math.max(0, now - period()));
  return Promise.resolve();
};

/** Leaves this run as it is and goes on in a copy of it. @param {number} at */
export const branch = single((/** @type {number} */ at) =>
  attempt(async () => {
    const { relatives, experiment } = store.get();
    if (!experiment) return;
    const title = `Branch ${letter(relatives.length)} at ${at.toFixed(1)} s`;
    const fork = await send(commands.fork(experiment.id, at, title));
    claim(fork.id);
    await session.open(fork.id);
    say({ tone: 'info', text: `${title}: its own future from here; the run it came from stays as it is.` });
  }));

/** @param {number} n */
function letter(n) {
  return String.fromCharCode(65 + (n % 26));
}

/** Throws Problem: the form shows it at the field. @param {Record<string, unknown>} fault */
export const inject = (fault) => send(commands.inject(id(), fault));

/** @param {string} fault */
export const clear = (fault) => attempt(() => send(commands.clear(id(), fault)));

export const clearAll = () => attempt(() => send(commands.clearAll(id())));

/** @param {string} name @param {boolean} enabled */
export const switchSubsystem = (name, enabled) => attempt(() => send(commands.switch(id(), name, enabled)));

/** Throws Problem: the form shows it at the field. @param {Record<string, unknown>} settings */
export const configure = (settings) => send(commands.configure(id(), settings));

/** Puts a channel into the fault form and goes there. @param {string} channel */
export function chooseChannel(channel) {
  const bench = /** @type {(HTMLElement & {choose(channel: string): void, focusForm(): void}) | null} */ (document.querySelector('ft-bench'));
  bench?.choose(channel);
  bench?.focusForm();
}

/** @type {number | null | undefined} */
let asked;
let looking = false;

/** Looks at a past moment; null comes back to now. @param {number | null} time */
export function look(time) {
  const { now } = store.get();
  const cursor = time === null || time >= now - period() / 2 ? null : Math.max(0, time);
  store.set(({ pastView }) => ({ cursor, pastView: cursor === null ? null : pastView }));
  asked = cursor;
  if (!looking) void lookOn();
}

/** One question at a time, and only the last one asked: dragging never builds a queue. */
async function lookOn() {
  looking = true;
  while (asked !== undefined) {
    const time = asked;
    asked = undefined;
    const experiment = id();
    const seen = time === null ? null : await read.view(experiment, time).catch(() => null);
    await moveScene(experiment, time).catch(() => undefined);
    if (seen && store.get().cursor !== null && id() === experiment) store.set({ pastView: seen });
  }
  looking = false;
}

/** @param {[number, number] | null} zoom */
export function zoomTo(zoom) {
  const { experiment } = store.get();
  if (!zoom || !experiment) return store.set({ zoom: null });
  const from = Math.max(0, zoom[0]);
  const to = Math.min(experiment.clock.duration, zoom[1]);
  const least = 4 * period();
  return store.set({ zoom: to - from < least ? null : [from, to] });
}

/** @param {string} chart */
export function toggleChart(chart) {
  const { shown } = store.get();
  session.show(shown.includes(chart) ? shown.filter((c) => c !== chart) : [...shown, chart]);
}

export const toggleGhost = single(() =>
  attempt(async () => {
    if (store.get().ghost) ghost.dismiss();
    else await ghost.summon();
  }));

/** Shows the page in a theme, for this visit. @param {'dark' | 'light'} theme */
export function wear(theme) {
  document.documentElement.dataset.theme = theme;
  store.set({ theme });
}

/** Shows the page in a theme, from now on. @param {'dark' | 'light'} theme */
export function setTheme(theme) {
  localStorage.setItem('theme', theme);
  wear(theme);
}

/** @param {string} scenario */
export const fly = single((/** @type {string} */ scenario) =>
  attempt(async () => {
    if (store.get().ghost) ghost.dismiss();
    await session.fly(scenario);
    store.set({ welcome: true });
  }));

/** Throws Problem: the form shows it at the field. @param {object} scenario a whole document @param {string} title */
export async function start(scenario, title) {
  if (store.get().ghost) ghost.dismiss();
  await session.create(scenario, { title });
  store.set({ welcome: false });
}

/** Throws Problem: the form shows it at the field. @param {FormData} form two files, as the server wants them */
export async function flyLog(form) {
  const experiment = await send(commands.log(form));
  claim(experiment.id);
  if (store.get().ghost) ghost.dismiss();
  await session.begin(experiment);
  store.set({ welcome: true });
}

/** @param {string} experiment */
export const open = (experiment) =>
  attempt(async () => {
    if (store.get().ghost) ghost.dismiss();
    await session.open(experiment);
  });

export const shareLink = () =>
  attempt(async () => {
    const { now, cursor, shown, zoom, follow, theme, picture, large, experiment } = store.get();
    const scenario = await read.document(id());
    const title = experiment && experiment.title !== experiment.scenario.title ? experiment.title : null;
    const address = await link({ scenario, time: now, cursor, charts: shown, zoom, follow, title, theme, picture, large });
    await copy(address, 'Link copied: it restores scenario, seed, every command, this cursor, these charts and how the page looks.');
    return address;
  });

/** @param {[string, string, object?]} command */
export function copyCurl(command) {
  return copy(curl(...command), 'curl command copied.');
}

/** @param {string} text @param {string} done */
export async function copy(text, done) {
  try {
    await navigator.clipboard.writeText(text);
    say({ tone: 'info', text: done });
  } catch {
    say({ tone: 'info', text: text, sticky: true, verbatim: true });
  }
}
