/** What a panel says while the page looks back and the panel does not: that it shows now. */
import { h, setText } from '../dom.js';
import { clock, decimalsOf } from '../format.js';
import { period, store } from '../store.js';
/** @import {Panel} from '../dom.js' */

/** A moment, to the epoch. @param {number} time */
export const moment = (time) => clock(time, decimalsOf(period()));

/** @param {Panel} panel @param {string} [words] */
export function nowTag(panel, words = 'now,') {
  const tag = h('span', { class: 'now-tag', hidden: true, title: 'This does not follow the cursor: it shows the newest epoch' });
  panel.watch((s) => [s.cursor === null, s.cursor === null ? 0 : s.now], () => {
    const { cursor, now } = store.get();
    tag.hidden = cursor === null;
    if (cursor !== null) setText(tag, `${words} ${moment(now)}`);
  });
  return tag;
}
