/** Before the first epoch: what flies here, what to try, and one big button. */
import { Panel, fill, h } from '../dom.js';
import { store } from '../store.js';
import { run } from '../actions.js';
import { sentence } from '../marks.js';

export class Welcome extends Panel {
  build() {
    this.setAttribute('role', 'region');
    this.setAttribute('aria-label', 'What to try');
    this.watch((s) => [s.welcome && s.now === 0 && s.experiment?.clock.state === 'paused', s.experiment?.scenario.id, s.scenarios, s.events], () => {
      const { welcome, now, experiment, scenarios, events, description } = store.get();
      this.hidden = !(welcome && now === 0 && experiment);
      if (this.hidden || !experiment) return;
      // What is said before the first epoch: a log that does not keep to what is assumed of it, for one.
      const remarks = events.filter((event) => event.time === 0 && typeof event.detail.text === 'string');
      const scenario = scenarios.find((s) => s.id === experiment.scenario.id);
      fill(this, h('button', { class: 'mini dismiss', 'aria-label': 'Dismiss', title: 'Dismiss', onclick: () => store.set({ welcome: false }) }, '×'),
        h('h2', {}, experiment.scenario.title), scenario?.summary && h('p', {}, scenario.summary),
        experiment.scenario.hint && h('p', { class: 'hint' }, experiment.scenario.hint),
        ...remarks.map((event) => h('p', { class: 'remark', role: 'note' }, `${sentence(event, description)}.`)),
        h('div', { class: 'start' }, h('button', { class: 'primary big', onclick: run }, 'Run'),
          h('span', { class: 'dim' }, 'or press ', h('kbd', {}, 'space'), '; ', h('kbd', {}, '?'), ' lists all keys')));
    });
  }
}

customElements.define('ft-welcome', Welcome);
