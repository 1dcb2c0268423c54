/** A server that has no room for one more experiment: those there are, to open one or to delete one, in place of a flight. */
import { Panel, fill, h } from '../dom.js';
import { read } from '../api.js';
import { capital } from '../format.js';
import { store } from '../store.js';
import { attempt } from '../actions.js';
import { COLUMNS, rows } from './experiments.js';

export class Full extends Panel {
  build() {
    this.setAttribute('role', 'region');
    this.setAttribute('aria-label', 'No room on the server');
    this.watch((s) => [s.full, !s.experiment], () => {
      const { full, experiment } = store.get();
      this.hidden = !full || !!experiment;
      if (!this.hidden) void attempt(() => this.#draw());
    });
  }

  async #draw() {
    const all = await read.experiments();
    const { full } = store.get();
    if (!full) return;
    fill(this, h('h2', {}, 'This server is full'), h('p', {}, `${capital(full.text)}. Then this page opens by itself; or open one of them and watch.`),
      h('table', {}, h('thead', {}, h('tr', {}, ...COLUMNS.map((t) => h('th', { scope: 'col' }, t)))), h('tbody', {}, ...rows(all, () => undefined, full.again))));
  }
}

customElements.define('ft-full', Full);
