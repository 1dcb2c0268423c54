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
import { attempt, look, say } from './actions.js';
import { Problem, read } from './api.js';
import * as session from './session.js';
import { unpack } from './share.js';
import { store } from './store.js';
/** @import {Scenario} from './types' */

const FIRST = 'zhang-1992-visible';

function theme() {
  const kept = localStorage.getItem('theme');
  const light = matchMedia('(prefers-color-scheme: light)');
  const apply = () => {
    const chosen = localStorage.getItem('theme') ?? (light.matches ? 'light' : 'dark');
    document.documentElement.dataset.theme = chosen;
    store.set({ theme: chosen === 'light' ? 'light' : 'dark' });
  };
  apply();
  if (!kept) light.addEventListener('change', apply);
}

/** Opens what the address carries (a shared run) or names (an experiment), else the first scenario. */
async function arrive() {
  const scenarios = read.scenarios().then((list) => {
    store.set({ scenarios: list });
    return list;
  });
  const shared = await unpack(location.hash);
  const named = new URL(location.href).searchParams.get('experiment');
  if (shared) {
    await session.create(shared.scenario, { until: shared.time });
    look(shared.cursor);
  } else if (!(named && (await found(named)))) {
    await session.fly(FIRST).catch((error) => another(error, scenarios));
    store.set({ welcome: true });
  }
  await scenarios;
}

/** @param {string} experiment named in the address */
async function found(experiment) {
  try {
    await session.open(experiment);
    store.set({ welcome: store.get().now === 0 });
    return true;
  } catch (error) {
    if (!(error instanceof Problem) || error.status !== 404) throw error;
    say({ tone: 'warning', text: 'The experiment in this address is no longer on the server; here is a fresh one.' });
    return false;
  }
}

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
  if (location.hash.startsWith('#run=')) void attempt(enter);
});
