/** Which charts are shown: a menu of all that the system declares, by family. */
import { fill, freshId, h } from '../dom.js';
import { capital } from '../format.js';
import { show } from '../session.js';
import { store } from '../store.js';
import { toggleChart } from '../actions.js';
/** @import {Panel} from '../dom.js' */

/** @param {Panel} panel @returns {HTMLElement} */
export function chooser(panel) {
  const id = freshId('chooser');
  const list = h('div', { id, popover: 'auto', class: 'menu chooser', 'aria-label': 'Charts' });
  const button = h('button', { class: 'mini', popovertarget: id, 'aria-haspopup': 'true' }, 'Charts');
  list.addEventListener('beforetoggle', () => {
    const box = button.getBoundingClientRect();
    list.style.setProperty('left', `${box.left}px`);
    list.style.setProperty('top', `${box.bottom + 4}px`);
  });
  panel.watch((s) => [s.description, s.shown], () => {
    const { description, shown } = store.get();
    const charts = description?.charts ?? [];
    button.textContent = `Charts ${shown.length} of ${charts.length} ▾`;
    const focused = document.activeElement instanceof HTMLInputElement ? document.activeElement.value : null;
    const groups = [...new Set(charts.map((c) => c.group))];
    fill(list, ...groups.map((group) => {
      const members = charts.filter((c) => c.group === group);
      const all = members.every((c) => shown.includes(c.id));
      return h('fieldset', {},
        h('legend', {}, capital(group), h('button', { class: 'mini', onclick: () => {
          const rest = shown.filter((one) => !members.some((c) => c.id === one));
          show(all ? rest : [...rest, ...members.map((c) => c.id)]);
        } }, all ? 'none' : 'all')),
        ...members.map((chart) => {
          const number = charts.indexOf(chart) + 1;
          return h('label', {}, h('input', { type: 'checkbox', value: chart.id, checked: shown.includes(chart.id), onchange: () => toggleChart(chart.id) }),
            h('span', {}, chart.title), number <= 9 && h('kbd', {}, number));
        }));
    }));
    if (focused && list.matches(':popover-open')) /** @type {HTMLElement | null} */ (list.querySelector(`input[value="${CSS.escape(focused)}"]`))?.focus();
  });
  return h('span', {}, button, list);
}
