/** Starts the page: panels, theme, and the experiment that the address names, carries, or none does. */
import './panels/topbar.js';
import './panels/notices.js';
import './panels/diagram.js';
import './panels/scene.js';
import './panels/score.js';
import './panels/welcome.js';
import './panels/full.js';
import './panels/charts.js';
import './panels/bench.js';
import './panels/faults.js';
import './panels/subsystems.js';
import './panels/settings.js';
import './panels/timeline.js';
import './panels/log.js';
import './panels/popover.js';
import './panels/keys.js';
import './panels/table.js';
import './panels/rest.js';
import './panels/experiments.js';
import './panels/parameters.js';
import './panels/receiver.js';
import './panels/confirm.js';
import { attempt, look, say, wear, zoomTo } from './actions.js';
import { Problem, read } from './api.js';
import * as session from './session.js';
import { unpack } from './share.js';
import { store } from './store.js';
/** @import {Scenario} from './types' */

const FIRST = 'zhang-1992-visible';
/** How an address begins that carries a run. */
const SHARED = '#run=';

function theme() {
  const kept = localStorage.getItem('theme');
  const light = matchMedia('(prefers-color-scheme: light)');
  const apply = () => {
    const chosen = localStorage.getItem('theme') ?? (light.matches ? 'light' : 'dark');
    wear(chosen === 'light' ? 'light' : 'dark');
  };
  apply();
  if (!kept) light.addEventListener('change', apply);
}

/**
 * Opens what the address carries (a shared run) or names (an experiment), else the first scenario. Whatever is wrong with an
 * address, the page that it leads to is a living one, and says what was wrong until it has been read.
 */
async function arrive() {
  const scenarios = read.scenarios().then((list) => {
    store.set({ scenarios: list });
    return list;
  });
  const { hash } = location;
  const named = new URL(location.href).searchParams.get('experiment');
  const arrived = (hash.startsWith(SHARED) && (await restored(hash))) || (named && (await found(named)));
  if (!arrived && !store.get().experiment) {
    await session.fly(FIRST).catch((error) => another(error, scenarios));
    store.set({ welcome: true });
  }
  // What could not be opened is not asked for again by a reload.
  session.remember(store.get().experiment?.id ?? null);
  await scenarios;
}

/** Flies a shared run again. @param {string} hash @returns {Promise<boolean>} whether it could be flown */
async function restored(hash) {
  try {
    const shared = await unpack(hash);
    await session.create(shared.scenario, { until: shared.time, title: shared.title ?? undefined });
    if (shared.charts) session.show(shared.charts);
    if (shared.theme) wear(shared.theme);
    store.set({ welcome: false, follow: shared.follow, large: shared.large, ...(shared.picture && { picture: shared.picture }) });
    zoomTo(shared.zoom);
    look(shared.cursor);
    return true;
  } catch (error) {
    if (!(error instanceof Error) || fatal(error)) throw error;
    const why = error instanceof Problem ? `The run in this link cannot be flown on this server: ${error.message}.` : error.message;
    say({ tone: 'warning', text: `${why} ${instead()}` });
    return false;
  }
}

/** @param {string} experiment named in the address @returns {Promise<boolean>} whether it is there */
async function found(experiment) {
  try {
    await session.open(experiment);
    store.set({ welcome: store.get().now === 0 });
    return true;
  } catch (error) {
    if (!(error instanceof Error) || fatal(error)) throw error;
    const why = error instanceof Problem && error.status === 404 ? 'is no longer on the server: it was deleted, or the server was started anew' : `cannot be opened: ${error.message}`;
    say({ tone: 'warning', text: `The experiment in this address ${why}. ${instead()}` });
    return false;
  }
}

/** Whether an error would meet any other experiment too: no server, no token, no room. @param {Error} error */
function fatal(error) {
  return error instanceof Problem && [0, 401, 429].includes(error.status);
}

const instead = () => (store.get().experiment ? 'The experiment that was open stays.' : 'Here is a fresh experiment.');

/** A server without the usual first scenario starts with its own first one. @param {unknown} error @param {Promise<Scenario[]>} scenarios */
async function another(error, scenarios) {
  const [first] = await scenarios;
  if (!(error instanceof Problem) || error.status !== 404 || !first) throw error;
  await session.fly(first.id);
}

/** A server without room for this page is no reason for an empty one. */
async function enter() {
  try {
    await arrive();
    store.set({ full: null });
  } catch (error) {
    if (!(error instanceof Problem) || error.status !== 429 || store.get().experiment) throw error;
    store.set({ full: { text: error.message, again: () => attempt(enter) } });
  }
}

theme();
void attempt(enter);
store.watch((s) => !!s.experiment, (ready) => ready && performance.mark('ready'));
window.addEventListener('hashchange', () => {
  if (location.hash.startsWith(SHARED)) void attempt(enter);
});
