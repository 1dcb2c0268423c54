/**
 * Keeps a frame of this origin from taking the page's main thread. The 3-D scene shares it; drawn in software, one of its
 * frames takes tens of milliseconds. So its animation frames are paced: what one costs decides when the next may come.
 */

/** Share of the main thread that the scene may take, at rest and while a person turns it. */
const SHARE = 0.1;
const SHARE_IN_HAND = 0.6;
const LONGEST = 1200;
const IN_HAND = 700;
/** After a click or a key on the page the scene waits this long: what was asked for is drawn first. */
const COURTESY = 400;

let heldUntil = 0;
for (const kind of ['pointerdown', 'click', 'keydown']) {
  document.addEventListener(kind, () => { heldUntil = performance.now() + COURTESY; }, { capture: true, passive: true });
}

/** @param {Window & typeof globalThis} view the frame's window, after it has loaded */
export function govern(view) {
  const request = view.requestAnimationFrame.bind(view);
  /** @type {Map<number, FrameRequestCallback>} */
  const asked = new Map();
  const after = new MessageChannel();
  let serial = 0;
  let pending = false;
  let started = 0;
  let cost = 0;
  let ended = 0;
  let touched = -IN_HAND;

  const ask = () => {
    if (pending || !asked.size) return;
    pending = true;
    const share = performance.now() - touched < IN_HAND ? SHARE_IN_HAND : SHARE;
    const now = performance.now();
    const wait = Math.max(heldUntil, ended + Math.min(LONGEST, cost * (1 / share - 1))) - now;
    if (wait > 17) setTimeout(() => request(draw), wait - 8);
    else request(draw);
  };

  /** @param {number} time */
  const draw = (time) => {
    started = performance.now();
    const callbacks = [...asked.values()];
    asked.clear();
    for (const callback of callbacks) callback(time);
    after.port2.postMessage(null);
  };

  // Comes after the frame was painted and handed over, so its whole cost is known.
  after.port1.onmessage = () => {
    ended = performance.now();
    cost = 0.5 * cost + 0.5 * (ended - started);
    pending = false;
    ask();
  };

  view.requestAnimationFrame = (callback) => {
    serial += 1;
    asked.set(serial, callback);
    ask();
    return serial;
  };
  view.cancelAnimationFrame = (id) => void asked.delete(id);
  for (const kind of ['pointerdown', 'pointermove', 'wheel']) {
    view.addEventListener(kind, (event) => {
      if (kind !== 'pointermove' || /** @type {PointerEvent} */ (event).buttons) touched = performance.now();
    }, { passive: true, capture: true });
  }
}
