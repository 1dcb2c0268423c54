/** Draws one dirty, visible thing per animation frame, and at most a share of the time. */

/** @typedef {{visible: boolean, paint: () => void}} Paintable */

/** Share of the main thread that drawing may take while data stream in; layout and paint come on top. */
const SHARE = 0.22;

/** @type {Set<Paintable>} */
const dirty = new Set();
let asked = false;
let urgent = false;
let rest = 0;

/** @param {Iterable<Paintable>} things @param {boolean} [now] answers a person: draw without rest */
export function repaint(things, now = false) {
  for (const thing of things) dirty.add(thing);
  if (now) urgent = true;
  ask();
}

/** @param {Paintable} thing */
export function forget(thing) {
  dirty.delete(thing);
}

function ask() {
  if (asked || !dirty.size) return;
  asked = true;
  const wait = urgent ? 0 : rest - performance.now();
  if (wait > 17) setTimeout(() => requestAnimationFrame(paint), wait - 16);
  else requestAnimationFrame(paint);
}

function paint() {
  asked = false;
  for (const thing of dirty) {
    if (!thing.visible) continue;
    dirty.delete(thing);
    const started = performance.now();
    thing.paint();
    const took = performance.now() - started;
    rest = performance.now() + took * (1 / SHARE - 1);
    break;
  }
  if ([...dirty].some((thing) => thing.visible)) ask();
  else urgent = false;
}
