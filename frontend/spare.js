/**
 * Experiments that a page made and nobody has touched. A page takes one over instead of making another, and leaves none behind: a server
 * keeps few, and every visit would use one up.
 * @import {Experiment} from './types'
 */
import { Problem, answered, commands, read, send } from './api.js';
import { store } from './store.js';

/** A stream that was closed here is gone on the server a little later [ms]. */
const PARTING = 1500;

/** What this page has made; what others made, by the REST interface perhaps, is not its to delete while there is room. */
const made = new Set();

/** What this page is about to delete: not to be taken over meanwhile. */
const leaving = new Set();

/** @param {string} id */
export function own(id) {
  made.add(id);
}

/**
 * Whether an experiment that a page made stands as it was made from a ready scenario, and nobody watches it but those counted.
 * @param {Experiment} one
 * @param {Experiment[]} all
 * @param {number} [watchers]
 */
async function untouched(one, all, watchers = 0) {
  const { clock, scenario } = one;
  if (!one.spare || clock.time > 0 || clock.state !== 'paused' || one.watchers > watchers || one.parent || one.ghost_of || one.title !== scenario.title) return false;
  if (all.some((other) => other.parent === one.id || other.ghost_of === one.id)) return false;
  const known = store.get().scenarios;
  const [document, ready] = await Promise.all([read.document(one.id), known.length ? known : read.scenarios()]);
  return JSON.stringify(document) === JSON.stringify(ready.find((s) => s.id === scenario.id));
}

/** One to take over. @param {string} scenario its id @returns {Promise<Experiment | null>} */
export async function spare(scenario) {
  try {
    const all = await read.experiments();
    for (const one of all) if (one.scenario.id === scenario && !leaving.has(one.id) && (await untouched(one, all)) && !leaving.has(one.id)) return one;
  } catch (error) {
    if (!(error instanceof Problem)) throw error;
  }
  return null;
}

/**
 * Deletes one that nobody has touched, of whatever scenario; last of all the open one, which is to be left.
 * @returns {Promise<boolean>} whether there is room now
 */
export async function makeRoom() {
  const all = await read.experiments();
  const mine = store.get().experiment?.id;
  for (const one of [...all.filter((e) => e.id !== mine), ...all.filter((e) => e.id === mine)]) {
    if (!(await untouched(one, all, one.id === mine ? 1 : 0))) continue;
    await send(commands.remove(one.id));
    return true;
  }
  return false;
}

/** Deletes what this page has made and left, if it was never touched. @param {string | undefined} id */
export async function forsake(id) {
  if (!id || !made.delete(id)) return;
  leaving.add(id);
  await new Promise((resolve) => setTimeout(resolve, PARTING));
  await answered(id);
  try {
    const all = await read.experiments();
    const left = all.find((one) => one.id === id);
    if (left && (await untouched(left, all))) await send(commands.remove(id));
  } catch (error) {
    // Whatever went wrong, the experiment is still there, and the next page may take it over.
    if (!(error instanceof Problem)) throw error;
  } finally {
    leaving.delete(id);
  }
}
