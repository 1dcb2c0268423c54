/** A small button that copies an action as the REST call that does it. */
import { h } from '../dom.js';
import { copyCurl } from '../actions.js';

/** @param {() => [string, string, object?]} command @param {string} [what] */
export function curlButton(command, what = 'this') {
  return h('button', { type: 'button', class: 'mini curl', title: 'Copy as curl', 'aria-label': `Copy ${what} as curl`, onclick: () => copyCurl(command()) }, 'curl');
}
