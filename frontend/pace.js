/** How fast an experiment flies by the clock on the wall, and whether that is what was asked for. */

/** Rates are told over so many seconds of the wall clock, and not before half of them have gone by. */
const WINDOW = 4;
/** A flight that reaches this share of what was asked for is held; less is said. */
const HELD = 0.85;

export class Pace {
  /** Wall clock and flight, both in seconds. @type {[number, number][]} */
  #seen = [];

  forget() {
    this.#seen = [];
  }

  /** @param {number} wall seconds on the wall @param {number} flight seconds of flight */
  note(wall, flight) {
    const last = this.#seen.at(-1);
    // Rewound, or jumped ahead: what was flown before says nothing of the pace from here.
    if (last && flight < last[1]) this.forget();
    this.#seen.push([wall, flight]);
    while (this.#seen.length > 2 && wall - this.#seen[1][0] >= WINDOW) this.#seen.shift();
  }

  /** Seconds of flight a second; null before that can be told. */
  get rate() {
    const first = this.#seen[0];
    const last = this.#seen.at(-1);
    if (!first || !last || last[0] - first[0] < WINDOW / 2) return null;
    return (last[1] - first[1]) / (last[0] - first[0]);
  }
}

/**
 * What is said beside the speed that was asked for; nothing while it is held.
 * @param {number | 'max' | undefined} asked
 * @param {number | null} rate
 */
export function told(asked, rate) {
  if (rate === null || asked === undefined) return '';
  if (asked === 'max') return `flying ${times(rate)}`;
  return rate < HELD * asked ? `flying ${times(rate)} of ${asked}x` : '';
}

/** @param {number} rate */
function times(rate) {
  return `${rate >= 10 ? rate.toFixed(0) : rate.toFixed(1)}x`;
}
