/** The system's block diagram: live health on every block; a click opens what can be done to it. */
import { Panel, fill, h, setText, svg } from '../dom.js';
import { LEADING, LEFT, worded } from '../blocks.js';
import { HEALTH, healthSign } from '../health.js';
import { store } from '../store.js';
import { routes } from './wires.js';
/** @import {Block, Health, View} from '../types' */

const GRID = { width: 100, height: 68 };
/** Heights of the picture [px]; between them it grows while a block has no room for its words. */
const LEAST_HEIGHT = 266;
const MOST_HEIGHT = 470;
const GROWTH = 17;

/** @typedef {{x: number, y: number, width: number, height: number}} Box */
/** @typedef {{group: SVGGElement, sign: SVGPathElement, words: SVGGElement, block: Block, box: Box, told: string}} Drawn */

export class Diagram extends Panel {
  /** @type {Map<string, Drawn>} */
  #blocks = new Map();
  /** @type {{path: SVGPathElement, carries: string | null}[]} */
  #wires = [];
  /** How much higher the picture is than it would be without its words, and for which width and system. */
  #grown = 0;
  #grownFor = '';

  build() {
    this.picture = svg('svg', { role: 'group', 'aria-label': 'Block diagram' });
    this.frame = h('div', { class: 'picture' }, this.picture);
    this.append(h('h2', {}, 'System'), this.frame,
      h('div', { class: 'health-key', 'aria-hidden': 'true' }, ...Object.entries(HEALTH).map(([health, { word }]) =>
        h('span', {}, healthSign(/** @type {Health} */ (health)), word))));
    const size = new ResizeObserver(() => this.#draw());
    size.observe(this.frame);
    this.keep(() => size.disconnect());
    this.watch((s) => s.description, (description) => {
      const title = this.querySelector('h2');
      if (title) title.textContent = description?.title ?? 'System';
      this.#draw();
    });
    this.watch((s) => [s.pastView ?? s.view, s.cursor === null ? s.experiment?.subsystems : null], () => this.#update());
  }

  #draw() {
    const { description } = store.get();
    const width = this.frame?.clientWidth ?? 0;
    if (!this.picture || !description || width < 50) return;
    const key = `${description.id}/${width}`;
    if (key !== this.#grownFor) [this.#grownFor, this.#grown] = [key, 0];
    const height = Math.min(MOST_HEIGHT, Math.max(LEAST_HEIGHT, Math.min(width * 0.86, window.innerHeight * 0.375)) + this.#grown);
    const sx = width / GRID.width;
    const sy = height / GRID.height;
    this.picture.setAttribute('viewBox', `0 0 ${width} ${height}`);
    this.picture.setAttribute('height', String(height));
    this.#blocks.clear();
    const boxes = new Map(description.blocks.map((b) => [b.id, { x: b.x * sx, y: b.y * sy, width: b.width * sx, height: b.height * sy }]));
    this.#wires = routes(description.wires, boxes).map(({ path, carries }) => ({ path: svg('path', { class: 'wire', d: path }), carries }));
    fill(this.picture, svg('defs', {}, svg('marker', { id: 'arrow', viewBox: '0 0 6 6', refX: 5.4, refY: 3, markerWidth: 5, markerHeight: 5, orient: 'auto' }, svg('path', { d: 'M0 0.6L5.5 3L0 5.4Z' }))),
      ...this.#wires.map((w) => w.path), ...description.blocks.map((b) => this.#block(b, /** @type {DOMRect} */ (boxes.get(b.id)))));
    this.#update();
  }

  /** @param {Block} block @param {Box} box */
  #block(block, box) {
    const badge = `translate(${box.x + box.width - 3} ${box.y + 2})`;
    const sign = svg('path', { class: 'sign', transform: badge });
    const words = svg('g', {});
    const act = () => this.dispatchEvent(new CustomEvent('block', { bubbles: true, detail: { block, anchor: group } }));
    const title = svg('title');
    const group = svg('g', {
      class: `block ${block.kind}`, tabindex: 0, role: 'button', 'aria-haspopup': 'dialog',
      onclick: act, onkeydown: (/** @type {KeyboardEvent} */ event) => {
        if (event.key !== 'Enter' && event.key !== ' ') return;
        event.preventDefault();
        event.stopPropagation();
        act();
      },
    }, title, svg('rect', { x: box.x, y: box.y, width: box.width, height: box.height, rx: 5 }), svg('circle', { class: 'halo', r: 7, transform: badge }), sign, words);
    this.#blocks.set(block.id, { group, sign, words, block, box, told: '' });
    return group;
  }

  #update() {
    const { view, pastView, experiment, cursor } = store.get();
    const seen = pastView ?? view;
    let cut = false;
    for (const drawn of this.#blocks.values()) {
      const state = seen?.blocks[drawn.block.id] ?? { health: /** @type {Health} */ ('ok'), text: '' };
      drawn.group.setAttribute('class', `block ${drawn.block.kind} ${state.health}`);
      drawn.sign.setAttribute('d', HEALTH[state.health].path);
      if ((drawn.told !== state.text || !drawn.words.firstChild) && this.#write(drawn, state.text)) cut = true;
      setText(/** @type {Element} */ (drawn.group.firstElementChild), `${drawn.block.label}: ${state.text}`);
      drawn.group.setAttribute('aria-label', `${drawn.block.label}: ${HEALTH[state.health].word}. ${state.text}`);
    }
    const open = new Set(this.#excluded(seen));
    if (cursor === null) {
      for (const [name, state] of Object.entries(experiment?.subsystems ?? {})) if (!state.used) open.add(name);
    }
    if (cut && Number(this.picture?.getAttribute('height')) < MOST_HEIGHT) {
      this.#grown += GROWTH;
      return this.#draw();
    }
    for (const { path, carries } of this.#wires) path.classList.toggle('open', carries !== null && open.has(carries));
  }

  /** @param {Drawn} drawn @param {string} state @returns {boolean} whether something had to be cut */
  #write(drawn, state) {
    const { block, box, words } = drawn;
    drawn.told = state;
    const { name, nameSize, squeezed, state: lines, stateSize, cut } = worded(block.label, state, box.width, box.height);
    const x = box.x + LEFT;
    let y = box.y + 5;
    /** @param {string} text @param {string} kind @param {number} size @param {Record<string, unknown>} [more] */
    const line = (text, kind, size, more) => {
      y += size + LEADING;
      return svg('text', { class: kind, x, y: y - LEADING - 1, style: { 'font-size': `${size}px` }, ...more }, text);
    };
    fill(words, ...name.map((text) => line(text, 'label', nameSize, squeezed ? { textLength: box.width - LEFT - 4, lengthAdjust: 'spacingAndGlyphs' } : {})),
      ...lines.map((text) => line(text, 'state', stateSize)));
    return cut;
  }

  /** Subsystems that the view shows as shut out. @param {View | null} view */
  #excluded(view) {
    return [...this.#blocks.values()]
      .filter(({ block }) => block.subsystem && ['isolated', 'off'].includes(view?.blocks[block.id]?.health ?? ''))
      .map(({ block }) => String(block.subsystem));
  }
}

customElements.define('ft-diagram', Diagram);
