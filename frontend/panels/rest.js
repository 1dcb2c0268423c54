/** The last calls the page made of the server, each as curl. */
import { Panel, fill, h } from '../dom.js';
import { callMade, calls, curl } from '../api.js';
import { copy } from '../actions.js';

export class Rest extends Panel {
  build() {
    this.list = h('ol', { class: 'calls' });
    this.dialog = h('dialog', { class: 'drawer', 'aria-label': 'REST calls' },
      h('header', {}, h('h2', {}, 'What this page asked of the server'), h('a', { href: '/docs', target: '_blank', rel: 'noopener' }, 'API reference'),
        h('form', { method: 'dialog' }, h('button', { class: 'mini', 'aria-label': 'Close' }, '×'))),
      h('p', { class: 'dim' }, 'Everything the page does, a script can do. Newest first.'), this.list);
    this.append(this.dialog);
    const redraw = () => this.dialog?.open && this.#draw();
    callMade.addEventListener('call', redraw);
    this.keep(() => callMade.removeEventListener('call', redraw));
  }

  open() {
    this.#draw();
    this.dialog?.showModal();
  }

  #draw() {
    if (!this.list) return;
    fill(this.list, ...calls.map((call) => {
      const command = curl(call.method, call.path, call.body);
      return h('li', {}, h('span', { class: `status ${call.status && call.status < 400 ? '' : 'bad'}` }, `${call.status ?? '…'} · ${call.ms.toFixed(0)} ms`),
        h('code', {}, command), h('button', { class: 'mini', onclick: () => copy(command, 'curl command copied.') }, 'copy'));
    }), !calls.length && h('li', { class: 'dim' }, 'Nothing yet: run, inject or switch something.'));
  }
}

customElements.define('ft-rest', Rest);
