/**
 * The experiment that is open: its stream, what has been recorded of it, and the address that finds it again.
 * @import {Event, Experiment, SystemDescription} from './types'
 */
import { Problem, commands, read, send } from './api.js';
import { claim } from './mine.js';
import { Pace } from './pace.js';
import { Recording } from './recording.js';
import { atBeat } from './scheduler.js';
import { forsake, makeRoom, own, spare } from './spare.js';
import { share, store } from './store.js';
import { Stream } from './stream.js';
import { signalsOf } from './traces.js';

export const recording = new Recording();
/** Says when recorded data changed; charts listen. */
export const recorded = new EventTarget();
/** Says when an event arrived from the stream (not when history is read); the announcer listens. */
export const happened = new EventTarget();

const SCORE_EVERY = 2500;
/** The server streams no more signals than this to one page. */
const MOST_SIGNALS = 500;
/** Beyond this many epochs the server thins its recording, and counting rows says nothing. */
const LONGEST = 30000;

/** @type {Map<string, SystemDescription>} */
const systems = new Map();
/** @type {Stream | null} */
let stream = null;
let loading = 0;
/** @type {import('./types').Series[]} */
let queued = [];
let scoreDue = 0;
const pace = new Pace();

const changed = () => recorded.dispatchEvent(new CustomEvent('change'));

/** Signals that the shown charts need. */
export function wanted() {
  const { description, shown } = store.get();
  const names = new Set();
  for (const chart of description?.charts ?? []) {
    if (!shown.includes(chart.id)) continue;
    for (const name of signalsOf(chart)) names.add(name);
  }
  return /** @type {string[]} */ ([...names].slice(0, MOST_SIGNALS));
}

/**
 * Opens an experiment that exists on the server.
 * @param {string | Experiment} which its id, or itself as the server just answered it
 */
export async function open(which) {
  const experiment = typeof which === 'string' ? await read.experiment(which) : which;
  const { id } = experiment;
  const description = await system(experiment.system);
  close();
  const same = store.get().description?.id === description.id;
  store.set({
    experiment, description, events: [], now: experiment.clock.time, view: null, pastView: null, cursor: null, zoom: null,
    ghost: null, score: null, connection: 'connecting', prefill: null, rate: null,
    shown: same ? store.get().shown : remembered(description),
  });
  remember(id);
  stream = new Stream(
    id,
    {
      state: heardState,
      frames: (series) => {
        if (loading) queued.push(series);
        else recording.append(series);
        atBeat('frames', () => {
          if (recording.length && !loading) store.set({ now: recording.last, rate: paced(recording.last) });
          if (performance.now() > scoreDue) void refreshScore();
        });
        changed();
      },
      event: heardEvent,
      view: (seen) => atBeat('view', () => store.set(({ view: before }) => ({ view: share(before, seen) }))),
      reset: heardReset,
      link: heardLink,
    },
    () => (recording.length ? recording.last : null),
  );
  stream.subscribe(wanted());
  await Promise.all([reload(), reloadEvents(), refreshScore(), refreshRelatives(), view()]);
}

/** The pace of a flight that is at `time`, while it runs. @param {number} time */
function paced(time) {
  if (store.get().experiment?.clock.state !== 'running') return null;
  pace.note(performance.now() / 1000, time);
  return pace.rate;
}

export function close() {
  pace.forget();
  stream?.close();
  stream = null;
  recording.reset([]);
  changed();
}

/** @param {string} id */
async function system(id) {
  const known = systems.get(id) ?? (await read.system(id));
  systems.set(id, known);
  return known;
}

/** Reads the recorded past of all wanted signals anew. */
export async function reload() {
  const { experiment } = store.get();
  if (!experiment) return;
  const names = wanted();
  const turn = (loading = performance.now());
  queued = [];
  stream?.subscribe(names);
  try {
    const series = names.length ? await read.series(experiment.id, names) : { time: [], signals: {} };
    if (turn !== loading) return;
    recording.reset(names);
    recording.append(series);
    for (const late of queued) recording.append(late);
  } catch (error) {
    if (!(error instanceof Problem)) throw error;
  } finally {
    if (turn === loading) {
      loading = 0;
      queued = [];
    }
  }
  changed();
}

async function reloadEvents() {
  const id = store.get().experiment?.id;
  if (!id) return;
  const events = await read.events(id).catch(() => null);
  if (!events || store.get().experiment?.id !== id) return;
  // What the stream told meanwhile is newer than the answer.
  store.set(({ events: heard }) => ({ events: [...events, ...heard.filter((event) => event.index >= events.length)] }));
}

async function view() {
  const { experiment } = store.get();
  if (!experiment || store.get().view) return;
  const seen = await read.view(experiment.id, experiment.clock.time).catch(() => null);
  if (seen && !store.get().view) store.set({ view: seen });
}

export async function refreshScore() {
  const id = store.get().experiment?.id;
  if (!id) return;
  scoreDue = performance.now() + SCORE_EVERY;
  const score = await read.score(id).catch(() => null);
  if (score && store.get().experiment?.id === id) store.set(({ score: before }) => ({ score: share(before, score) }));
}

/** Experiments of the same family: what this one was forked from, and what was forked from those. */
export async function refreshRelatives() {
  const { experiment } = store.get();
  if (!experiment) return;
  const all = await read.experiments().catch(() => /** @type {Experiment[]} */ ([]));
  const byId = new Map(all.map((e) => [e.id, e]));
  /** @param {Experiment} e */
  const root = (e) => {
    let top = e;
    for (let up = byId.get(top.parent ?? ''); up; up = byId.get(top.parent ?? '')) top = up;
    return top.id;
  };
  const mine = byId.get(experiment.id);
  store.set({ relatives: mine ? all.filter((e) => !e.ghost_of && root(e) === root(mine)) : [experiment] });
}

/** @param {number} time */
function heardReset(time) {
  recording.truncate(time);
  queued = queued.filter((series) => series.time[0] <= time);
  store.set(({ cursor, pastView, zoom, events }) => ({
    now: time,
    events: events.filter((event) => event.time <= time + 1e-9),
    ...(cursor !== null && cursor > time ? { cursor: null, pastView: null } : { cursor, pastView }),
    zoom: zoom && zoom[0] >= time ? null : zoom,
  }));
  changed();
  void reloadEvents();
  void refreshScore();
}

/** @param {Experiment} experiment */
function heardState(experiment) {
  const before = store.get().experiment;
  if (before && before.id !== experiment.id) return;
  const { time, state, epoch, speed } = experiment.clock;
  if (state !== before?.clock.state || speed !== before.clock.speed) pace.forget();
  store.set({ experiment: share(before, experiment), now: time, rate: state === 'running' ? pace.rate : null });
  const stopped = before?.clock.state === 'running' && state !== 'running';
  if (!stopped) return;
  changed();
  void refreshScore();
  // Frames that were skipped while this page lagged are fetched now that there is time for them.
  if (!loading && recording.length < Math.min(epoch, LONGEST)) void reload();
}

/** @param {Event} event */
function heardEvent(event) {
  const { events } = store.get();
  if (event.index < events.length) return;
  if (event.index > events.length) {
    void reloadEvents();
  } else {
    store.set(({ now }) => ({ events: [...events, event], now: Math.max(now, event.time) }));
  }
  happened.dispatchEvent(new CustomEvent('event', { detail: event }));
  if (performance.now() > scoreDue - SCORE_EVERY + 500) void refreshScore();
}

/** @param {'connecting' | 'open' | 'lost' | 'gone'} link @param {boolean} again */
async function heardLink(link, again) {
  const id = store.get().experiment?.id;
  store.set({ connection: link });
  if (link === 'open' && again) {
    await Promise.all([reload(), reloadEvents(), refreshScore(), refreshRelatives()]);
  } else if (link === 'lost' && id) {
    try {
      await read.experiment(id);
    } catch (error) {
      if (error instanceof Problem && error.status === 404 && store.get().experiment?.id === id) {
        stream?.close();
        store.set({ connection: 'gone' });
      }
    }
  }
}

/** The address finds this experiment again after a reload. @param {string | null} id */
export function remember(id) {
  const url = new URL(location.href);
  url.hash = '';
  if (id) url.searchParams.set('experiment', id);
  else url.searchParams.delete('experiment');
  history.replaceState(null, '', url);
}

/** Charts shown when the page opens: what was chosen last for this system, else what it declares. @param {SystemDescription} description */
function remembered(description) {
  const kept = sessionStorage.getItem(`charts/${description.id}`);
  const names = new Set(kept ? kept.split('\n') : description.charts.filter((c) => c.shown).map((c) => c.id));
  return description.charts.map((c) => c.id).filter((id) => names.has(id));
}

/** @param {string[]} shown */
export function show(shown) {
  const { description } = store.get();
  if (!description) return;
  sessionStorage.setItem(`charts/${description.id}`, shown.join('\n'));
  store.set({ shown: description.charts.map((c) => c.id).filter((id) => shown.includes(id)) });
  void reload();
}

/**
 * Opens a ready scenario, paused at the start: one that is on the server and that nobody has touched, else a new one.
 * @param {string} scenario
 */
export async function fly(scenario) {
  const idle = await spare(scenario);
  if (idle) {
    try {
      await begin(idle);
      claim(idle.id);
      const { watchers } = await read.experiment(idle.id);
      // Two pages may have found it at the same time: then each makes its own.
      if (watchers <= 1) return;
    } catch (error) {
      if (!(error instanceof Problem) || error.status !== 404) throw error;
    }
  }
  await create(scenario);
}

/**
 * Puts a scenario on the server and opens it, paused at the start.
 * @param {string | object} scenario
 * @param {{until?: number, title?: string}} [to]
 */
export async function create(scenario, to = {}) {
  const make = () => /** @type {Promise<Experiment>} */ (send(commands.create(scenario, to.title)));
  const experiment = await make().catch(async (error) => {
    if (!(error instanceof Problem) || error.status !== 429 || !(await makeRoom())) throw error;
    return make();
  });
  own(experiment.id);
  claim(experiment.id);
  try {
    await begin(experiment, to);
  } catch (error) {
    // Nobody would ever see it.
    await send(commands.remove(experiment.id)).catch(() => undefined);
    throw error;
  }
}

/**
 * Opens an experiment that has just been put on the server, at a speed that fits its length.
 * @param {Experiment} experiment
 * @param {{until?: number}} [to]
 */
export async function begin(experiment, to = {}) {
  const left = store.get().experiment?.id;
  const [paced] = await Promise.all([
    send(commands.clock(experiment.id, { speed: fitting(experiment.clock.duration) })),
    system(experiment.system),
  ]);
  if (to.until) {
    store.set({ busy: 'Flying the shared experiment again, to the same bits …' });
    try {
      await send(commands.advance(experiment.id, { until: Math.min(to.until, experiment.clock.duration) }));
    } finally {
      store.set({ busy: null });
    }
  }
  await open(to.until ? experiment.id : paced);
  void forsake(left);
}

export const SPEEDS = [0.5, 1, 2, 5, 10, 20, 50, 100];

/** A speed at which a flight of this length is watched in a quarter of a minute or so. @param {number} duration */
function fitting(duration) {
  return SPEEDS.find((speed) => duration / speed <= 15) ?? 100;
}
