/** The 3-D scene: a frame of this origin, with the legend beside it. */
import { Panel, fill, h } from '../dom.js';
import { moveScene } from '../api.js';
import { loadPlotly } from '../charts.js';
import { govern } from '../governor.js';
import { store } from '../store.js';

const PATIENCE = 15000;
const SETTLE = 400;

export class Scene extends Panel {
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  #timer;
  /** @type {ReturnType<typeof setInterval> | undefined} */
  #poll;
  /** @type {Document | null} */
  #paced = null;
  /** @type {string | null} */
  #wanted = null;
  /** Which of the system's pictures is shown. */
  #picture = '';
  #shown = sessionStorage.getItem('scene') !== 'off';

  build() {
    this.pictures = h('div', { class: 'pictures', role: 'group', 'aria-label': 'Pictures of the scene' });
    this.frame = h('iframe', { title: '3-D scene: axes, planes and lines of sight', hidden: true });
    this.status = h('p', { class: 'status' }, 'Loading the scene …');
    this.legend = h('div', { class: 'legend', role: 'note', 'aria-label': 'Legend of the scene' });
    this.toggle = h('button', { class: 'mini', 'aria-pressed': 'true', onclick: () => this.#flip() }, 'hide');
    this.append(h('h2', {}, 'Scene', this.toggle), h('div', { class: 'stage' }, this.status, this.frame, this.pictures), this.legend);
    this.frame.addEventListener('load', () => this.#loaded());
    this.watch((s) => [s.experiment?.id, s.theme, s.connection === 'open'], () => this.#load());
    this.watch((s) => s.description, (description) => {
      this.#picture = (description && sessionStorage.getItem(`picture/${description.id}`)) ?? '';
      this.hidden = !!description && !description.scene.length;
      this.#describe();
    });
    this.watch((s) => [s.experiment?.id, s.connection === 'open'], () => {
      if (store.get().connection === 'open' && this.#picture) this.#show(this.#picture);
    });
  }

  /** Pictures to choose from, and the legend of the one that is shown. */
  #describe() {
    const items = store.get().description?.scene ?? [];
    const all = [...new Set(items.map((item) => item.picture))];
    if (!all.includes(this.#picture)) this.#picture = all[0] ?? '';
    fill(this.pictures ?? this, ...(all.length > 1 ? all : []).map((picture) =>
      h('button', { class: 'mini', 'aria-pressed': String(picture === this.#picture), onclick: () => this.#show(picture) }, picture)));
    const families = [...new Set(items.map((item) => item.family))];
    const shown = new Set(items.filter((item) => item.picture === this.#picture).map((item) => item.family));
    fill(this.legend ?? this, ...families.map((family, i) => shown.has(family) && h('span', {}, h('i', { class: `swatch family-${i % 6}` }), family)),
      families.length > 0 && h('span', {}, h('i', { class: 'swatch faulted' }), 'faulted'),
      families.length > 0 && h('span', {}, h('i', { class: 'swatch isolated' }), 'isolated'));
  }

  /** @param {string} picture */
  #show(picture) {
    const { description, experiment, cursor } = store.get();
    this.#picture = picture;
    if (description) sessionStorage.setItem(`picture/${description.id}`, picture);
    if (experiment && new Set(description?.scene.map((item) => item.picture)).size > 1) void moveScene(experiment.id, cursor, picture).catch(() => undefined);
    this.#describe();
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
      this.frame.removeAttribute('src');
      this.frame.hidden = true;
      return;
    }
    const own = `/experiments/${encodeURIComponent(experiment.id)}/scene/`;
    // The frame of another experiment would go on asking for it, even after it is deleted.
    if (!this.frame.getAttribute('src')?.startsWith(own)) {
      this.frame.removeAttribute('src');
      this.frame.hidden = true;
    }
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
      this.frame.src = address;
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
    if (page.defaultView) govern(page.defaultView);
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
