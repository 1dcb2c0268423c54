/** The 3-D scene: a frame of this origin, with the legend beside it. */
import { Panel, fill, h } from '../dom.js';
import { moveScene } from '../api.js';
import { loadPlotly } from '../charts.js';
import { govern } from '../governor.js';
import { store } from '../store.js';
import { press } from './keys.js';
import { SceneLabels } from './scene_labels.js';
/** @import {Choice} from '../labels' */

const PATIENCE = 15000;
/** Colours of families; then they come again. */
const PALETTE = 8;
const SETTLE = 400;
/** Keys that the page answers while the scene has them. */
const PASSED = ['Escape', 'v'];
/** @type {[Choice, string][]} */
const CHOICES = [['important', 'key names'], ['all', 'all names'], ['none', 'no names']];

export class Scene extends Panel {
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  #timer;
  /** @type {ReturnType<typeof setInterval> | undefined} */
  #poll;
  /** @type {Document | null} */
  #paced = null;
  /** @type {string | null} */
  #wanted = null;
  /** What the legend tells of; null where it is to be told anew. @type {string | null} */
  #told = null;
  /** Families whose names are shown by a press. @type {Set<string>} */
  #chosen = new Set();
  #shown = sessionStorage.getItem('scene') !== 'off';

  build() {
    this.pictures = h('div', { class: 'pictures', role: 'group', 'aria-label': 'Pictures of the scene' });
    this.frame = this.#newFrame();
    this.labels = new SceneLabels();
    this.status = h('p', { class: 'status' }, 'Loading the scene …');
    this.legend = h('div', { class: 'legend', role: 'note', 'aria-label': 'Legend of the scene' });
    this.toggle = h('button', { class: 'mini', 'aria-pressed': 'true', onclick: () => this.#flip() }, 'hide');
    this.size = h('button', { class: 'mini size', onclick: () => store.set(({ large }) => ({ large: !large })) });
    this.stage = h('div', { class: 'stage' }, this.status, this.frame, this.labels.element, this.pictures);
    this.append(h('h2', {}, 'Scene', h('span', { class: 'acts' }, this.#chooser(), this.size, this.toggle)), this.stage, this.legend);
    const size = new ResizeObserver(() => this.labels?.draw());
    size.observe(this.stage);
    this.keep(() => size.disconnect());
    this.watch((s) => s.large, (large) => this.#resize(large));
    this.watch((s) => s.pastView ?? s.view, () => {
      this.labels?.draw();
      this.#tell();
    });
    this.watch((s) => [s.experiment?.id, s.theme, s.connection === 'open'], () => this.#load());
    this.watch((s) => s.description, (description) => {
      store.set({ picture: (description && sessionStorage.getItem(`picture/${description.id}`)) ?? '' });
      this.hidden = !!description && !description.scene.length;
    });
    this.watch((s) => [s.description, s.picture], () => this.#describe());
    this.watch((s) => [s.experiment?.id, s.connection === 'open', s.picture], () => this.#turn());
  }

  /** Pictures to choose from, and the legend of the one that is shown. */
  #describe() {
    const { all, shown } = this.#offered();
    fill(this.pictures ?? this, ...(all.length > 1 ? all : []).map((picture) =>
      h('button', { class: 'mini', 'aria-pressed': String(picture === shown), onclick: () => this.#show(picture) }, picture)));
    this.labels?.offer((store.get().description?.scene ?? []).filter((item) => item.picture === shown));
    this.#told = null;
    this.#tell();
  }

  /** The legend: of what is there at the moment shown, and of nothing else. A press names all of a family, or no longer. */
  #tell() {
    const { description, view, pastView } = store.get();
    const items = description?.scene ?? [];
    const seen = pastView ?? view;
    const { shown } = this.#offered();
    const there = items.filter((item) => item.picture === shown && seen?.items[item.id]?.visible);
    const families = [...new Set(items.map((item) => item.family))].map((family, i) => ({ family, i })).filter(({ family }) => there.some((item) => item.family === family));
    const healths = ['faulted', 'suspect', 'isolated', 'off'].filter((health) => there.some((item) => seen?.items[item.id]?.health === health));
    const told = [...families.map(({ family }) => family), ...healths].join();
    if (!this.legend || !this.labels || told === this.#told) return;
    this.#told = told;
    const { labels } = this;
    const point = (/** @type {string} */ family, /** @type {boolean} */ at) => {
      if (at) labels.families.add(family);
      else if (!this.#chosen.has(family)) labels.families.delete(family);
      labels.draw();
    };
    fill(this.legend, ...families.map(({ family, i }) => {
      const button = h('button', {
        class: 'mini', 'aria-pressed': String(this.#chosen.has(family)), title: `Name all of ${family}`,
        onpointerenter: () => point(family, true), onpointerleave: () => point(family, false),
        onclick: () => {
          if (!this.#chosen.delete(family)) this.#chosen.add(family);
          button.setAttribute('aria-pressed', String(this.#chosen.has(family)));
          point(family, this.#chosen.has(family));
        },
      }, h('i', { class: `swatch family-${i % PALETTE}` }), family);
      return button;
    }), ...healths.map((health) => h('span', {}, h('i', { class: `swatch ${health}` }), health)));
  }

  /** Which names are shown. */
  #chooser() {
    const kept = localStorage.getItem('names');
    const select = h('select', { class: 'mini', 'aria-label': 'Names in the scene', title: 'Names in the scene; the others are told when the pointer is at a thing', onchange: () => {
      localStorage.setItem('names', select.value);
      choose();
    } }, ...CHOICES.map(([choice, label]) => h('option', { value: choice, selected: choice === kept }, label)));
    const choose = () => {
      if (!this.labels) return;
      this.labels.choice = /** @type {Choice} */ (select.value);
      this.labels.draw();
    };
    choose();
    return select;
  }

  /** @param {boolean} large */
  #resize(large) {
    if (!this.size) return;
    this.classList.toggle('large', large);
    this.size.textContent = large ? 'back' : 'full size';
    this.size.title = large ? 'Back to its place (v or Esc)' : 'Over the whole page (v)';
    this.size.setAttribute('aria-pressed', String(large));
    if (large && !this.#shown) this.#flip();
  }

  /** A frame whose visits leave no trace: an address that is given before it stands on the page is no step back. @param {string} [address] */
  #newFrame(address) {
    const frame = h('iframe', { title: '3-D scene: axes, planes and lines of sight', hidden: true, src: address });
    frame.addEventListener('load', () => this.#loaded());
    return frame;
  }

  /** @param {string} [address] none: an empty frame */
  #visit(address) {
    const frame = this.#newFrame(address);
    this.labels?.follow(null);
    this.frame?.replaceWith(frame);
    this.frame = frame;
  }

  /** @param {string} picture */
  #show(picture) {
    const { description } = store.get();
    if (description) sessionStorage.setItem(`picture/${description.id}`, picture);
    store.set({ picture });
  }

  /** The system's pictures, and the one that is shown: the first where none of them was chosen. */
  #offered() {
    const { description, picture } = store.get();
    const all = [...new Set(description?.scene.map((item) => item.picture))];
    return { all, shown: all.includes(picture) ? picture : all[0] ?? '' };
  }

  /** Has the server show the picture that is chosen here. */
  #turn() {
    const { experiment, cursor, connection, picture } = store.get();
    const { all, shown } = this.#offered();
    if (!experiment || connection !== 'open' || all.length < 2 || shown !== picture) return;
    void moveScene(experiment.id, cursor, shown).catch(() => undefined);
  }

  #flip() {
    this.#shown = !this.#shown;
    sessionStorage.setItem('scene', this.#shown ? 'on' : 'off');
    this.#load();
  }

  #load() {
    const { experiment, theme, connection } = store.get();
    if (!this.frame || !this.status || !this.toggle) return;
    this.toggle.setAttribute('aria-pressed', String(this.#shown));
    this.toggle.textContent = this.#shown ? 'hide' : 'show';
    this.classList.toggle('folded', !this.#shown);
    if (!this.#shown || !experiment || connection === 'gone') {
      this.#wanted = null;
      if (this.frame.getAttribute('src')) this.#visit();
      return;
    }
    const own = `/experiments/${encodeURIComponent(experiment.id)}/scene/`;
    // The frame of another experiment would go on asking for it, even after it is deleted.
    const before = this.frame.getAttribute('src');
    if (before && !before.startsWith(own)) this.#visit();
    if (connection !== 'open') return;
    const address = `${own}${theme === 'dark' ? '?darkMode' : ''}`;
    this.status.textContent = 'Loading the scene …';
    clearTimeout(this.#timer);
    // Charts and controls come first: the scene is the heaviest part of the page.
    const ready = loadPlotly().catch(() => undefined).then(() => new Promise((done) => setTimeout(done, SETTLE)));
    this.#wanted = address;
    void ready.then(() => {
      if (!this.frame || this.#wanted !== address) return;
      this.#wanted = null;
      this.#visit(address);
      clearInterval(this.#poll);
      this.#poll = setInterval(() => this.#pace(), 20);
      this.#timer = setTimeout(() => this.#unavailable(), PATIENCE);
    });
  }

  /** The frame has a page; whether it is the scene or a refusal, its own document says. */
  #loaded() {
    if (!this.frame || !this.frame.getAttribute('src')) return;
    const page = this.frame.contentDocument;
    const scene = page?.querySelector('script, canvas, #root');
    if (!scene) return this.#unavailable();
    clearTimeout(this.#timer);
    this.#pace();
    this.frame.hidden = false;
  }

  /** Paces the frame from the moment its page is there, before it draws anything. */
  #pace() {
    const page = this.frame?.contentDocument;
    if (!page || !page.URL.includes('/scene/') || this.#paced === page) return;
    clearInterval(this.#poll);
    this.#paced = page;
    if (!page.defaultView) return;
    govern(page.defaultView);
    this.labels?.follow(page.defaultView);
    page.defaultView.addEventListener('keydown', (event) => PASSED.includes(event.key) && press(event));
  }

  #unavailable() {
    clearTimeout(this.#timer);
    clearInterval(this.#poll);
    if (!this.frame || !this.status) return;
    this.frame.hidden = true;
    fill(this.status, 'Scene unavailable. The diagram tells the same. ', h('button', { class: 'mini', onclick: () => this.#load() }, 'Try again'));
  }
}

customElements.define('ft-scene', Scene);
