/**
 * The page's beat. While data stream in, what changed is drawn together, some ten times a second: the newest state, and
 * as many dirty, visible charts as fit. What answers a person is drawn with the next frame, one chart a frame.
 */

/** @typedef {{visible: boolean, paint: () => void}} Paintable */

/** Least time between two beats [ms]. */
const BEAT = 95;
/** Drawing a chart is begun only while a beat has taken less than this [ms]. */
const ENOUGH = 9;
/** Share of the main thread that beats may take; the browser's layout and paint come on top. */
const SHARE = 0.24;
/** Longest rest after a beat [ms]: on a busy machine the page gets slower, never stale. */
const LONGEST_REST = 400;

/** @type {Set<Paintable>} */
const dirty = new Set();
/** @type {Map<string, () => void>} */
const waiting = new Map();
/** Frames can fail to come, where the 3-D scene is drawn in software; then the state moves on without them [ms]. */
const PATIENCE = 300;
let asked = false;
let urgent = false;
let next = 0;

/** @param {Iterable<Paintable>} things @param {boolean} [now] answers a person */
export function repaint(things, now = false) {
  for (const thing of things) dirty.add(thing);
  if (now) urgent = true;
  ask();
}

/** Does something with the next beat; only the last of a name is done. @param {string} name @param {() => void} act */
export function atBeat(name, act) {
  waiting.set(name, act);
  ask();
}

/** @param {Paintable} thing */
export function forget(thing) {
  dirty.delete(thing);
}

function ask() {
  if (asked || (!dirty.size && !waiting.size)) return;
  asked = true;
  const wait = urgent ? 0 : next - performance.now();
  if (wait > 17) setTimeout(frame, wait - 16);
  else frame();
}

function frame() {
  const late = setTimeout(settle, PATIENCE);
  requestAnimationFrame(() => {
    clearTimeout(late);
    beat();
  });
}

function settle() {
  for (const act of [...waiting.values()]) act();
  waiting.clear();
}

function beat() {
  asked = false;
  const started = performance.now();
  settle();
  for (const thing of [...dirty].filter((one) => one.visible)) {
    dirty.delete(thing);
    thing.paint();
    if (urgent || performance.now() - started > ENOUGH) break;
  }
  const took = performance.now() - started;
  next = Math.max(started + BEAT, started + took + Math.min(LONGEST_REST, took * (1 / SHARE - 1)));
  if ([...dirty].some((thing) => thing.visible)) ask();
  else urgent = false;
}
