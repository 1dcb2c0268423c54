/** Names laid over the frame of the 3-D scene: they follow its camera, never overlap, and answer the pointer. */
import { fill, h, keyed, setText, svg } from '../dom.js';
import { REACH, arranged, nameable, projected } from '../labels.js';
import { store } from '../store.js';
/** @import {SceneItem} from '../types' */
/** @import {Camera, Choice, Placed} from '../labels' */

const FONT = '11px system-ui, "DejaVu Sans", sans-serif';
const measure = /** @type {CanvasRenderingContext2D} */ (document.createElement('canvas').getContext('2d'));
/** @type {Map<string, number>} */
const widths = new Map();

/** @param {string} text */
function widthOf(text) {
  let width = widths.get(text);
  if (width === undefined) {
    measure.font = FONT;
    width = measure.measureText(text).width;
    widths.set(text, width);
  }
  return width;
}

export class SceneLabels {
  /** @type {(Window & {ftlabCamera?: Camera}) | null} */
  #view = null;
  /** @type {SceneItem[]} */
  #items = [];
  #asked = false;
  /** What the pointer is at. @type {string | null} */
  #item = null;
  /** Families that are named whatever is chosen, by a press or while pointed at. @type {Set<string>} */
  families = new Set();
  /** @type {Choice} */
  choice = 'important';

  constructor() {
    this.lines = svg('svg', {});
    this.names = h('div', {});
    this.left = h('span', { class: 'left-out', hidden: true, title: 'There is no room for these names: point at a thing, make the scene larger, or choose a family in the legend' });
    this.element = h('div', { class: 'labels', 'aria-hidden': 'true' }, this.lines, this.names, this.left);
  }

  /** Follows the camera and the pointer of a frame's window; null: of none. @param {Window | null} view */
  follow(view) {
    this.#view = view;
    view?.addEventListener('ftlab-camera', () => this.draw());
    view?.addEventListener('pointermove', (event) => this.#point(/** @type {PointerEvent} */ (event)), { passive: true });
    view?.document.addEventListener('pointerleave', () => this.#pointAt(null));
    this.draw();
  }

  /** What can be named. @param {SceneItem[]} items */
  offer(items) {
    this.#items = items;
    this.draw();
  }

  /** Draws with the next frame of the page; asked twice, once. */
  draw() {
    if (this.#asked) return;
    this.#asked = true;
    requestAnimationFrame(() => {
      this.#asked = false;
      this.#draw();
    });
  }

  #size() {
    return { width: this.element.clientWidth, height: this.element.clientHeight };
  }

  #seen() {
    const { view, pastView } = store.get();
    return pastView ?? view;
  }

  #draw() {
    const camera = this.#view?.ftlabCamera;
    const size = this.#size();
    const named = nameable(this.#items, this.#seen(), this.choice, { families: this.families, item: this.#item });
    const { placed, left } = camera && size.width > 40 && size.height > 40 ? arranged(named, camera, size, this.choice, widthOf) : { placed: [], left: 0 };
    keyed(this.names, placed, (p) => p.id, (p) => h('span', { 'data-item': p.id }), (element, p) => {
      setText(element, p.text);
      element.className = `name ${p.id.startsWith('ground/') ? 'ground' : p.health}`;
      element.style.transform = `translate(${(p.x - p.width / 2).toFixed(1)}px, ${(p.y - 7).toFixed(1)}px)`;
      element.style.width = `${p.width.toFixed(1)}px`;
    });
    this.lines.setAttribute('viewBox', `0 0 ${size.width} ${size.height}`);
    fill(this.lines, ...placed.filter((p) => p.far).map((p) => leader(p)));
    this.left.hidden = !left || this.choice === 'none';
    setText(this.left, `+${left}`);
  }

  /** @param {PointerEvent} event */
  #point(event) {
    const camera = this.#view?.ftlabCamera;
    if (!camera || event.buttons) return;
    let nearest = REACH;
    let found = null;
    for (const one of nameable(this.#items, this.#seen(), 'all', { families: new Set(this.#items.map((item) => item.family)), item: null })) {
      const tip = projected(camera, this.#size(), one.at);
      const away = tip && !one.id.startsWith('ground/') ? Math.hypot(tip[0] - event.clientX, tip[1] - event.clientY) : Infinity;
      if (away < nearest) [nearest, found] = [away, one.id];
    }
    this.#pointAt(found);
  }

  /** @param {string | null} id */
  #pointAt(id) {
    if (id === this.#item) return;
    this.#item = id;
    this.draw();
  }
}

/** From a name to what it belongs to. @param {Placed} p */
function leader(p) {
  return svg('line', { x1: p.tip[0], y1: p.tip[1], x2: Math.min(p.x + p.width / 2, Math.max(p.x - p.width / 2, p.tip[0])), y2: p.y + (p.tip[1] > p.y ? 7 : -7) });
}
