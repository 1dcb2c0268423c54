/**
 * One store: an immutable state, replaced, never changed. Panels watch the slice they draw.
 * @import {State} from './types'
 */

/**
 * @template S
 * @param {S} initial
 */
export function createStore(initial) {
  let state = initial;
  let flushing = false;
  /** @type {Set<() => void>} */
  const watchers = new Set();

  function flush() {
    flushing = false;
    for (const check of [...watchers]) check();
  }

  return {
    get: () => state,
    /** @param {Partial<S> | ((state: S) => Partial<S>)} change */
    set(change) {
      state = { ...state, .../** @type {Partial<S>} */ (typeof change === 'function' ? change(state) : change) };
      if (flushing) return;
      flushing = true;
      queueMicrotask(flush);
    },
    /**
     * Calls `react` now and whenever the slice changes. A slice that is a fresh array is compared item by item.
     * @template T
     * @param {(state: S) => T} select
     * @param {(slice: T) => void} react
     * @returns {() => void} stop watching
     */
    watch(select, react) {
      let last = select(state);
      const check = () => {
        const next = select(state);
        if (same(last, next)) return;
        last = next;
        react(next);
      };
      watchers.add(check);
      react(last);
      return () => watchers.delete(check);
    },
  };
}

/** @param {unknown} a @param {unknown} b */
function same(a, b) {
  if (Object.is(a, b)) return true;
  return Array.isArray(a) && Array.isArray(b) && a.length === b.length && a.every((x, i) => Object.is(x, b[i]));
}

/**
 * Keeps every part of `before` that is equal in `after`, so that a watcher of an unchanged part is not woken.
 * @template T
 * @param {any} before
 * @param {T} after
 * @returns {T}
 */
export function share(before, after) {
  if (Object.is(before, after)) return before;
  if (typeof before !== 'object' || typeof after !== 'object' || before === null || after === null) return after;
  if (Array.isArray(before) !== Array.isArray(after)) return after;
  const keys = Object.keys(after);
  let equal = keys.length === Object.keys(before).length;
  /** @type {any} */
  const merged = Array.isArray(after) ? [] : {};
  for (const key of keys) {
    merged[key] = share(before[key], /** @type {any} */ (after)[key]);
    if (!Object.is(merged[key], before[key])) equal = false;
  }
  return equal ? before : merged;
}

/** @type {State} */
const initial = {
  scenarios: [],
  description: null,
  experiment: null,
  relatives: [],
  events: [],
  now: 0,
  view: null,
  pastView: null,
  cursor: null,
  hover: null,
  zoom: null,
  follow: null,
  shown: [],
  ghost: null,
  score: null,
  connection: 'idle',
  theme: 'dark',
  notice: null,
  welcome: false,
  full: null,
  prefill: null,
  busy: null,
  large: false,
  picture: '',
  rate: null,
};

export const store = createStore(initial);

/** Seconds between the epochs of what flies: the experiment's own where it has one. @param {State} [state] */
export function period({ experiment, description } = store.get()) {
  return experiment?.clock.period ?? description?.epoch ?? 1;
}
