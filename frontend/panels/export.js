/** What can be taken away from a run: numbers, report, scenario. */
import { freshId, h } from '../dom.js';
import { experimentPath, file, reportAddress } from '../api.js';
import { attempt, id } from '../actions.js';

const FILES = [
  { label: 'Data, CSV', path: 'series', accept: 'text/csv', ending: 'csv' },
  { label: 'Data, Parquet', path: 'series', accept: 'application/vnd.apache.parquet', ending: 'parquet' },
  { label: 'Scenario with commands, JSON', path: 'scenario', accept: 'application/json', ending: 'json' },
];

export function exportMenu() {
  const key = freshId('export');
  const button = h('button', { class: 'ghost', popovertarget: key, 'aria-haspopup': 'true' }, 'Export');
  const menu = h('div', { id: key, popover: 'auto', class: 'menu', 'aria-label': 'Export' },
    ...FILES.map(({ label, path, accept, ending }) => h('button', { class: 'item', onclick: () => {
      menu.hidePopover();
      void attempt(async () => download(await file(`${experimentPath(id())}/${path}`, accept), `ftlab-${id()}.${ending}`));
    } }, label)),
    h('button', { class: 'item', onclick: () => {
      menu.hidePopover();
      window.open(reportAddress(id()), '_blank', 'noopener');
    } }, 'Report, one HTML page'));
  menu.addEventListener('beforetoggle', () => {
    const box = button.getBoundingClientRect();
    menu.style.setProperty('right', `${window.innerWidth - box.right}px`);
    menu.style.setProperty('left', 'auto');
    menu.style.setProperty('top', `${box.bottom + 4}px`);
  });
  return h('span', {}, button, menu);
}

/** @param {Blob} blob @param {string} name */
export function download(blob, name) {
  const address = URL.createObjectURL(blob);
  h('a', { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), 10000);
}
