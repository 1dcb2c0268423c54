/** The system's block diagram: live health on every block; a click opens what can be done to it. */
import { Panel, fill, h, setText, svg } from '../dom.js';
import { HEALTH, healthSign } from '../health.js';
import { store } from '../store.js';
import { routes } from './wires.js';
/** @import {Block, Health, View} from '../types' */

const GRID = { width: 100, height: 68 };
const LEAST_HEIGHT = 236;
const LINE = 11.5;
/** How far a name may be narrowed before it is cut. */
const NARROWEST = 0.76;

/** @typedef {{group: SVGGElement, sign: SVGPathElement, label: SVGTextElement, text: SVGTextElement, block: Block, width: number}} Drawn */

export class Diagram extends Panel {
  /** @type {Map<string, Drawn>} */
  #blocks = new Map();
  /** @type {{path: SVGPathElement, carries: string | null}[]} */
  #wires = [];

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
    const height = Math.max(LEAST_HEIGHT, Math.min(width * 0.78, window.innerHeight * 0.36));
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

  /** @param {Block} block @param {{x: number, y: number, width: number, height: number}} box */
  #block(block, box) {
    const badge = `translate(${box.x + box.width - 3} ${box.y + 2})`;
    const sign = svg('path', { class: 'sign', transform: badge });
    const label = svg('text', { class: 'label', x: box.x + 7, y: box.y + 16 });
    const lines = Math.max(1, Math.min(3, Math.floor((box.height - 20) / LINE)));
    const text = svg('text', { class: 'state' }, ...Array.from({ length: lines }, (_, i) => svg('tspan', { x: box.x + 7, y: box.y + 29 + i * LINE })));
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
    }, title, svg('rect', { x: box.x, y: box.y, width: box.width, height: box.height, rx: 5 }), svg('circle', { class: 'halo', r: 7, transform: badge }), sign, label, text);
    const size = [11.5, 10.5, 9.5].find((px) => widthOf(block.label, `600 ${px}px`) <= box.width - 12) ?? 9.5;
    label.style.fontSize = `${size}px`;
    const room = box.width - 11;
    const wide = widthOf(block.label, `600 ${size}px`);
    const narrowed = wide > room && wide * NARROWEST <= room;
    if (narrowed) for (const [name, value] of [['textLength', room], ['lengthAdjust', 'spacingAndGlyphs']]) label.setAttribute(String(name), String(value));
    label.textContent = narrowed ? block.label : fitted(block.label, room, `600 ${size}px`);
    this.#blocks.set(block.id, { group, sign, label, text, block, width: box.width });
    return group;
  }

  #update() {
    const { view, pastView, experiment, cursor } = store.get();
    const seen = pastView ?? view;
    for (const drawn of this.#blocks.values()) {
      const state = seen?.blocks[drawn.block.id] ?? { health: /** @type {Health} */ ('ok'), text: '' };
      drawn.group.setAttribute('class', `block ${drawn.block.kind} ${state.health}`);
      drawn.sign.setAttribute('d', HEALTH[state.health].path);
      const lines = wrapped(state.text, drawn.width - 11, drawn.text.children.length);
      [...drawn.text.children].forEach((line, i) => setText(line, lines[i] ?? ''));
      setText(/** @type {Element} */ (drawn.group.firstElementChild), `${drawn.block.label}: ${state.text}`);
      drawn.group.setAttribute('aria-label', `${drawn.block.label}: ${HEALTH[state.health].word}. ${state.text}`);
    }
    const open = new Set(this.#excluded(seen));
    if (cursor === null) {
      for (const [name, state] of Object.entries(experiment?.subsystems ?? {})) if (!state.used) open.add(name);
    }
    for (const { path, carries } of this.#wires) path.classList.toggle('open', carries !== null && open.has(carries));
  }

  /** Subsystems that the view shows as shut out. @param {View | null} view */
  #excluded(view) {
    return [...this.#blocks.values()]
      .filter(({ block }) => block.subsystem && ['isolated', 'off'].includes(view?.blocks[block.id]?.health ?? ''))
      .map(({ block }) => String(block.subsystem));
  }
}

const measure = /** @type {CanvasRenderingContext2D} */ (document.createElement('canvas').getContext('2d'));
/** @type {Map<string, string>} */
const fits = new Map();

/** @param {string} text @param {string} font */
function widthOf(text, font) {
  measure.font = `${font} system-ui, "DejaVu Sans", sans-serif`;
  return measure.measureText(text).width;
}

/** Text over a few lines, the last one cut. @param {string} text @param {number} width @param {number} most */
function wrapped(text, width, most) {
  const lines = [''];
  for (const word of text.split(' ')) {
    const longer = lines[lines.length - 1] ? `${lines[lines.length - 1]} ${word}` : word;
    if (lines.length === most || widthOf(longer, '10px') <= width || !lines[lines.length - 1]) lines[lines.length - 1] = longer;
    else lines.push(word);
  }
  return lines.map((line) => fitted(line, width, '10px'));
}

/** Text cut to a width. @param {string} text @param {number} width @param {string} font */
function fitted(text, width, font) {
  const key = `${font}/${Math.round(width)}/${text}`;
  const known = fits.get(key);
  if (known !== undefined) return known;
  let shown = text;
  while (shown.length > 1 && widthOf(shown, font) > width) shown = `${shown.slice(0, -2).trimEnd()}…`;
  if (fits.size > 500) fits.clear();
  fits.set(key, shown);
  return shown;
}

customElements.define('ft-diagram', Diagram);
