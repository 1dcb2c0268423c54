/** Health has a colour and a shape: grey disc, yellow triangle, purple square, vermilion diamond, hollow ring. */
import { svg } from './dom.js';
/** @import {Health} from './types' */

/** @type {Record<Health, {path: string, word: string}>} */
export const HEALTH = {
  ok: { path: 'M0 -4A4 4 0 1 0 0 4A4 4 0 1 0 0 -4Z', word: 'ok' },
  faulted: { path: 'M0 -5.5L5.5 0L0 5.5L-5.5 0Z', word: 'fault' },
  suspect: { path: 'M0 -5L5.2 4.2L-5.2 4.2Z', word: 'suspected' },
  isolated: { path: 'M-4 -4H4V4H-4Z', word: 'isolated' },
  off: { path: 'M0 -3.6A3.6 3.6 0 1 0 0 3.6A3.6 3.6 0 1 0 0 -3.6Z', word: 'off' },
};

/** @param {Health} health */
export function healthSign(health) {
  return svg('svg', { class: `health ${health}`, width: 13, height: 13, viewBox: '-6.5 -6.5 13 13', 'aria-hidden': 'true' },
    svg('path', { d: HEALTH[health].path }));
}
