/** Right-angled routes between blocks; wires that end at the same block get entries of their own. */
/** @import {Wire} from '../types' */

/** @typedef {{x: number, y: number, width: number, height: number}} Box */

/**
 * @param {Wire[]} wires
 * @param {Map<string, Box>} boxes
 * @returns {{path: string, carries: string | null}[]}
 */
export function routes(wires, boxes) {
  const known = wires.filter((w) => boxes.has(w.source) && boxes.has(w.target));
  const side = known.map((w) => facing(box(boxes, w.source), box(boxes, w.target)));
  const all = [...boxes.values()];
  return known.map((wire, i) => {
    const source = box(boxes, wire.source);
    const target = box(boxes, wire.target);
    const exits = known.filter((w, k) => w.source === wire.source && side[k] === side[i]).map((w) => box(boxes, w.target));
    const entries = known.filter((w, k) => w.target === wire.target && side[k] === side[i]).map((w) => box(boxes, w.source));
    const others = all.filter((b) => b !== source && b !== target);
    return { path: route(source, target, side[i], share(exits, target, side[i]), share(entries, source, side[i]), others), carries: wire.carries };
  });
}

/** @param {Map<string, Box>} boxes @param {string} id @returns {Box} */
const box = (boxes, id) => /** @type {Box} */ (boxes.get(id));

/** @param {Box} source @param {Box} target @returns {'right' | 'left' | 'down' | 'up'} */
function facing(source, target) {
  if (target.x >= source.x + source.width) return 'right';
  if (target.x + target.width <= source.x) return 'left';
  return target.y > source.y ? 'down' : 'up';
}

/** Where along its edge a wire is fixed: peers in the order of their places, 0 to 1. @param {Box[]} peers @param {Box} one @param {string} side */
function share(peers, one, side) {
  const across = side === 'right' || side === 'left' ? (/** @type {Box} */ b) => b.y + b.height / 2 : (/** @type {Box} */ b) => b.x + b.width / 2;
  const sorted = [...peers].sort((a, b) => across(a) - across(b));
  return (sorted.indexOf(one) + 1) / (sorted.length + 1);
}

/**
 * @param {Box} source
 * @param {Box} target
 * @param {'right' | 'left' | 'down' | 'up'} side
 * @param {number} exit
 * @param {number} entry
 * @param {Box[]} others blocks to keep clear of
 */
function route(source, target, side, exit, entry, others) {
  if (side === 'right' || side === 'left') {
    const x1 = side === 'right' ? source.x + source.width : source.x;
    const x2 = side === 'right' ? target.x : target.x + target.width;
    const low = Math.max(source.y, target.y) + 5;
    const high = Math.min(source.y + source.height, target.y + target.height) - 5;
    const y1 = source.y + source.height * exit;
    const y2 = target.y + target.height * entry;
    if (low <= high && y1 >= low && y1 <= high) return `M${n(x1)} ${n(y1)}H${n(x2)}`;
    if (low <= high && y2 >= low && y2 <= high) return `M${n(x1)} ${n(y2)}H${n(x2)}`;
    const bend = clearest(x1, x2, y1, y2, 0.3 + 0.4 * (y2 > y1 ? 1 - entry : entry), others);
    return `M${n(x1)} ${n(y1)}H${n(bend)}V${n(y2)}H${n(x2)}`;
  }
  const y1 = side === 'down' ? source.y + source.height : source.y;
  const y2 = side === 'down' ? target.y : target.y + target.height;
  const low = Math.max(source.x, target.x) + 5;
  const high = Math.min(source.x + source.width, target.x + target.width) - 5;
  const x = target.x + target.width * entry;
  if (x >= low && x <= high) return `M${n(x)} ${n(y1)}V${n(y2)}`;
  const from = source.x + source.width * exit;
  return `M${n(from)} ${n(y1)}V${n((y1 + y2) / 2)}H${n(x)}V${n(y2)}`;
}

/**
 * Where a wire turns: the place nearest to the preferred one at which it crosses the fewest blocks.
 * @param {number} x1 @param {number} x2 @param {number} y1 @param {number} y2
 * @param {number} preferred share of the way
 * @param {Box[]} others
 */
function clearest(x1, x2, y1, y2, preferred, others) {
  let best = preferred;
  let least = Infinity;
  for (let i = 0; i <= 24; i += 1) {
    const place = 0.04 + (0.92 * i) / 24;
    const x = x1 + (x2 - x1) * place;
    const hits = others.filter((b) => crosses(b, x1, y1, x, y1) || crosses(b, x, y1, x, y2) || crosses(b, x, y2, x2, y2)).length;
    const cost = hits + 0.5 * Math.abs(place - preferred);
    if (cost < least) [best, least] = [place, cost];
  }
  return x1 + (x2 - x1) * best;
}

/** Whether a straight piece of wire runs through a block or touches it. @param {Box} b @param {number} xa @param {number} ya @param {number} xb @param {number} yb */
function crosses(b, xa, ya, xb, yb) {
  const gap = 4;
  return Math.max(xa, xb) > b.x - gap && Math.min(xa, xb) < b.x + b.width + gap && Math.max(ya, yb) > b.y - gap && Math.min(ya, yb) < b.y + b.height + gap;
}

/** @param {number} value */
const n = (value) => value.toFixed(1);
