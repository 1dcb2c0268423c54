/** What can be done to a block: break it, switch it, set it. */
import { Panel, fill, h } from '../dom.js';
import { HEALTH, healthSign } from '../health.js';
import { commands } from '../api.js';
import { faultText, fitted, unseen } from '../marks.js';
import { store } from '../store.js';
import { chooseChannel, clear, id, switchSubsystem } from '../actions.js';
import { curlButton } from './curl.js';
import { settingField } from './settings.js';
/** @import {Block, Channel, Health} from '../types' */

/** With more channels than this a list of them is no help; the form's own has a search. */
const MOST_CHIPS = 14;

/** A channel's name without what all of them begin with. @param {Channel} channel @param {Channel[]} all */
function short(channel, all) {
  const split = all.map((c) => c.label.split(' '));
  let common = 0;
  while (split.every((w) => w.length > common + 1 && w[common] === split[0][common])) common += 1;
  return channel.label.split(' ').slice(common).join(' ');
}

export class BlockPopover extends Panel {
  /** @type {Block | null} */
  #block = null;
  /** @type {SVGElement | null} */
  #anchor = null;

  build() {
    this.setAttribute('popover', 'auto');
    this.setAttribute('role', 'dialog');
    document.addEventListener('block', (event) => {
      const { block, anchor } = /** @type {CustomEvent} */ (event).detail;
      this.#open(block, anchor);
    });
    this.addEventListener('toggle', (event) => {
      if (/** @type {ToggleEvent} */ (event).newState !== 'closed') return;
      this.#block = null;
      this.#anchor?.focus();
    });
    this.watch((s) => [s.experiment?.faults, s.experiment?.subsystems, s.pastView ?? s.view], () => this.#draw());
  }

  /** @param {Block} block @param {SVGElement} anchor */
  #open(block, anchor) {
    this.#block = block;
    this.#anchor = anchor;
    this.setAttribute('aria-label', block.label);
    this.replaceChildren();
    this.#draw();
    const box = anchor.getBoundingClientRect();
    this.showPopover();
    const left = Math.min(box.right + 8, window.innerWidth - this.offsetWidth - 8);
    const top = Math.min(box.top, window.innerHeight - this.offsetHeight - 8);
    this.style.setProperty('left', `${Math.max(8, left)}px`);
    this.style.setProperty('top', `${Math.max(8, top)}px`);
    /** @type {HTMLElement | null} */ (this.querySelector('.acts button, .acts input, .acts select, button'))?.focus();
  }

  #draw() {
    const block = this.#block;
    const { experiment, description, view, pastView } = store.get();
    if (!block || !experiment || !description) return;
    if (this.contains(document.activeElement) && document.activeElement?.matches('input, select')) return;
    const state = (pastView ?? view)?.blocks[block.id];
    const focused = this.contains(document.activeElement) ? [...this.querySelectorAll('button')].indexOf(/** @type {HTMLButtonElement} */ (document.activeElement)) : -1;
    fill(this,
      h('header', {}, healthSign(state?.health ?? 'ok'), h('h3', {}, block.label), h('span', { class: 'dim' }, HEALTH[state?.health ?? 'ok'].word)),
      state?.text && h('p', { class: 'dim' }, state.text),
      h('div', { class: 'acts' }, this.#faults(block), this.#switch(block), this.#settings(block),
        !block.sensor && !block.subsystem && !block.settings.length && h('p', { class: 'dim' }, 'Nothing can be done to this block; it shows how it fares.')));
    if (focused >= 0) this.querySelectorAll('button')[Math.min(focused, this.querySelectorAll('button').length - 1)]?.focus();
  }

  /** @param {Block} block */
  #faults(block) {
    const { experiment, description, view, pastView } = store.get();
    const { sensor } = block;
    if (!sensor || !description) return null;
    const live = (experiment?.faults ?? []).filter((f) => f.channel.startsWith(sensor) && f.state !== 'ended');
    const absent = unseen(experiment);
    const channels = fitted({ description, experiment }).filter((c) => c.name.startsWith(sensor));
    if (!channels.length) return null;
    const present = channels.filter((c) => !absent.has(c.name));
    const choose = (/** @type {string} */ channel) => {
      this.#anchor = null;
      this.hidePopover();
      chooseChannel(channel);
    };
    /** @param {Channel} channel */
    const health = (channel) => {
      const item = description.scene.find((one) => one.channel === channel.name);
      return (item && (pastView ?? view)?.items?.[item.id]?.health) ?? 'ok';
    };
    return [
      h('button', { class: 'primary', onclick: () => choose((present[0] ?? channels[0]).name) }, 'Inject a fault here …'),
      present.length > 1 && present.length <= MOST_CHIPS && h('div', { class: 'chips', role: 'group', 'aria-label': 'Channels' }, ...present.map((c) =>
        h('button', { class: 'mini', title: `${c.label}: ${HEALTH[health(c)].word}. Choose it in the fault form`, onclick: () => choose(c.name) }, healthSign(health(c)), ' ', short(c, present)))),
      ...live.map((f) => h('div', { class: 'one' }, h('span', {}, faultText(f, description)), h('button', { 'aria-label': `Clear ${faultText(f, description)}`, onclick: () => clear(f.id) }, 'Clear'))),
    ];
  }

  /** @param {Block} block */
  #switch(block) {
    const name = block.subsystem;
    const state = name ? store.get().experiment?.subsystems[name] : undefined;
    if (!name || !state) return null;
    return h('div', { class: 'one' }, h('button', { onclick: () => switchSubsystem(name, !state.enabled) }, state.enabled ? 'Switch off' : 'Switch on'),
      curlButton(() => commands.switch(id(), name, !state.enabled)));
  }

  /** @param {Block} block */
  #settings(block) {
    const { description } = store.get();
    const known = block.settings.filter((name) => description?.settings_schema.properties?.[name]);
    return known.map((name) => settingField(name));
  }
}

customElements.define('ft-popover', BlockPopover);
