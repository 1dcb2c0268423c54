/**
 * The same run without the fault, drawn behind the live one: a second experiment on the server, kept abreast of it.
 * @import {Experiment} from './types'
 */
import { Problem, commands, read, send } from './api.js';
import { Recording } from './recording.js';
import { claim } from './mine.js';
import { recorded } from './session.js';
import { store } from './store.js';

export const ghostRecording = new Recording();
const EVERY = 1500;

/** @type {ReturnType<typeof setTimeout> | undefined} */
let timer;
let busy = false;

/** Signals worth a ghost: everything but thresholds and sigmas. */
function signals() {
  const { description, shown } = store.get();
  const traces = (description?.charts ?? []).filter((c) => c.kind === 'time' && shown.includes(c.id)).flatMap((c) => c.traces);
  return [...new Set(traces.filter((t) => t.role !== 'threshold' && t.role !== 'weight').map((t) => t.signal))];
}

export async function summon() {
  const { experiment } = store.get();
  if (!experiment) return;
  /** @type {Experiment} */
  const ghost = await send(commands.ghost(experiment.id));
  claim(ghost.id);
  if (store.get().experiment?.id !== experiment.id) return;
  store.set({ ghost });
  await follow();
}

export function dismiss() {
  const { ghost } = store.get();
  clearTimeout(timer);
  ghostRecording.reset([]);
  store.set({ ghost: null });
  recorded.dispatchEvent(new CustomEvent('change'));
  if (ghost) remove(ghost.id);
}

/** The server keeps few experiments; a ghost goes with its page. @param {string} id */
function remove(id) {
  const [method, path] = commands.remove(id);
  fetch(`/api/v1${path}`, { method, keepalive: true }).catch(() => undefined);
}

window.addEventListener('pagehide', () => {
  const { ghost } = store.get();
  if (ghost) remove(ghost.id);
});

/** Flies the ghost up to the live run and reads what is new, again and again. */
async function follow() {
  clearTimeout(timer);
  const { ghost, now } = store.get();
  if (!ghost || busy) return;
  busy = true;
  try {
    const names = signals();
    const fresh = names.some((name) => !ghostRecording.names.includes(name));
    if (now > ghost.clock.time + 1e-9) {
      const { experiment } = await send(commands.advance(ghost.id, { until: now }));
      if (store.get().ghost?.id === ghost.id) store.set({ ghost: experiment });
    }
    if (fresh) ghostRecording.reset(names);
    if (names.length && (fresh || ghostRecording.last < now)) {
      const start = fresh || !ghostRecording.length ? undefined : ghostRecording.last;
      ghostRecording.append(await read.series(ghost.id, ghostRecording.names, start));
      recorded.dispatchEvent(new CustomEvent('change'));
    }
  } catch (error) {
    if (!(error instanceof Problem)) throw error;
    store.set({ ghost: null, notice: { tone: 'warning', text: `The run without the fault is gone: ${error.message}` } });
    ghostRecording.reset([]);
    recorded.dispatchEvent(new CustomEvent('change'));
  } finally {
    busy = false;
  }
  if (store.get().ghost) timer = setTimeout(follow, EVERY);
}
