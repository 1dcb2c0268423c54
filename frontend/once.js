/**
 * The second click of a double click, and a key that is held, do nothing where doing it twice is doing it wrong: on buttons
 * and in forms that are marked `data-once`.
 */

/** @param {Event} event */
function repeats(event) {
  return event instanceof KeyboardEvent ? event.repeat && (event.key === 'Enter' || event.key === ' ') : /** @type {MouseEvent} */ (event).detail > 1;
}

for (const kind of ['click', 'keydown']) {
  document.addEventListener(kind, (event) => {
    if (!repeats(event) || !(event.target instanceof Element) || !event.target.closest('[data-once]')) return;
    event.preventDefault();
    event.stopImmediatePropagation();
  }, { capture: true });
}

/**
 * An action that is not begun again while it is under way; whoever asks meanwhile gets the same answer.
 * @template {any[]} A
 * @template T
 * @param {(...args: A) => Promise<T>} act
 * @returns {(...args: A) => Promise<T>}
 */
export function single(act) {
  /** @type {Promise<T> | null} */
  let underWay = null;
  return (...args) => {
    underWay ??= act(...args).finally(() => { underWay = null; });
    return underWay;
  };
}
