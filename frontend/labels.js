/**
 * Names beside what the 3-D scene shows: where each stands on the screen for a camera, and which of them there is room for.
 * No two of them overlap; what is abnormal is placed first.
 * @import {Health, SceneItem, View} from './types'
 */

/** @typedef {[number, number, number]} Vector */
/** @typedef {{wxyz: [number, number, number, number], position: Vector, fov: number}} Camera a camera of the frame: camera to world, z ahead, y down; `fov` is the vertical field of view [rad] */
/** @typedef {{id: string, text: string, health: Health, at: Vector, rank: number, must: boolean}} Named what may be named: `must` whatever the room */
/** @typedef {{width: number, height: number}} Size */
/** @typedef {{id: string, text: string, health: Health, x: number, y: number, width: number, tip: [number, number], far: boolean}} Placed centre of a name, and what it belongs to */
/** @typedef {'important' | 'all' | 'none'} Choice */

/** Body to level until an attitude is known: flying north. @type {[number, number, number, number]} */
const LEVEL_FLIGHT = [0, Math.SQRT1_2, Math.SQRT1_2, 0];
/** What a name says besides itself; brackets: out of use. @type {Partial<Record<Health, (name: string) => string>>} */
const MARKS = { faulted: (n) => `${n} fault`, suspect: (n) => `${n} alarm`, isolated: (n) => `(${n})`, off: (n) => `(${n} off)` };
/** Who comes first; what is sound comes after all of these. @type {Health[]} */
const ABNORMAL = ['faulted', 'isolated', 'suspect', 'off'];
/** Kinds that are named while they are sound, the rarest first. Planes, balls and the aircraft are known by the legend. */
const KINDS = ['vector', 'path', 'axis', 'spin', 'line-of-sight'];
/** Where the ground is drawn, and how far out its names stand [scene units]. */
const GROUND = { below: -0.9, out: 1.6 };
/** One important name in so much of the picture [px^2]. */
const CALM = 5200;
const LINE = 14;
const GAP = 3;
/** How near a pointer must be to have something named [px]. */
export const REACH = 16;

/** @param {[number, number, number, number]} q unit quaternion w, x, y, z @param {Vector} v @returns {Vector} */
export function turned([w, x, y, z], [a, b, c]) {
  const [i, j, k] = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [a + w * i + y * k - z * j, b + w * j + z * i - x * k, c + w * k + x * j - y * i];
}

/** Where a point is seen; null behind the camera. @param {Camera} camera @param {Size} size @param {Vector} point @returns {[number, number] | null} */
export function projected({ wxyz: [w, x, y, z], position, fov }, { width, height }, point) {
  const [right, down, ahead] = turned([w, -x, -y, -z], /** @type {Vector} */ (point.map((value, i) => value - position[i])));
  if (ahead < 1e-3) return null;
  const scale = height / 2 / Math.tan(fov / 2) / ahead;
  return [width / 2 + scale * right, height / 2 + scale * down];
}

/** Where the name of an item belongs, in its own frame. @param {SceneItem} item @param {Vector} v @returns {Vector} */
function place(item, v) {
  const length = Math.hypot(...v) || 1;
  if (item.kind === 'aircraft') return [0, 0, -0.2];
  if (item.kind === 'ball') return [0, 0, length];
  if (item.kind !== 'plane') return v;
  // A point of the patch: along its line of steepest climb, or anywhere where it lies level.
  const up = /** @type {Vector} */ (v.map((part, i) => (i === 2 ? 1 : 0) - (part * v[2]) / length ** 2));
  const climb = Math.hypot(...up);
  return climb < 1e-6 ? [0.6, 0, 0] : /** @type {Vector} */ (up.map((part) => (0.6 * part) / climb));
}

/**
 * What can be named in a picture at a moment, in the order in which it is placed.
 * @param {SceneItem[]} items those of the picture
 * @param {View | null} view
 * @param {Choice} choice
 * @param {{families: Set<string>, item: string | null}} asked families and the one item that a person points at or has chosen
 * @returns {Named[]}
 */
export function nameable(items, view, choice, { families, item: pointed }) {
  if (!view) return [];
  const attitude = Object.values(view.items).find((one) => one.rotation)?.rotation ?? LEVEL_FLIGHT;
  /** @type {Named[]} */
  const found = [];
  for (const item of items) {
    const seen = view.items[item.id];
    const vector = seen?.vector ?? (item.kind === 'aircraft' ? /** @type {Vector} */ ([0, 0, 0]) : null);
    if (!seen?.visible || !vector || (item.kind !== 'aircraft' && Math.hypot(...vector) < 1e-6)) continue;
    const { health } = seen;
    const must = item.id === pointed;
    const abnormal = ABNORMAL.indexOf(health);
    const chosen = families.has(item.family);
    if (!must && (choice === 'none' ? !chosen : abnormal < 0 && !chosen && !KINDS.includes(item.kind))) continue;
    const own = place(item, vector);
    found.push({
      id: item.id, text: MARKS[health]?.(item.label) ?? item.label, health, must,
      at: item.frame === 'body' || item.kind === 'aircraft' ? turned(attitude, own) : own,
      rank: must ? -2 : abnormal >= 0 ? abnormal : chosen ? ABNORMAL.length : ABNORMAL.length + 1 + KINDS.indexOf(item.kind),
    });
  }
  if (choice !== 'none' && items.some((item) => item.frame === 'level')) {
    for (const [text, x, y] of /** @type {[string, number, number][]} */ ([['N', 0, GROUND.out], ['E', GROUND.out, 0]])) {
      found.push({ id: `ground/${text}`, text, health: 'off', at: [x, y, GROUND.below], rank: 99, must: false });
    }
  }
  return found.sort((a, b) => a.rank - b.rank);
}

/**
 * Places names so that none overlaps another or leaves the picture; those without a place are left out.
 * @param {Named[]} named in the order of their importance
 * @param {Camera} camera
 * @param {Size} size of the picture [px]
 * @param {Choice} choice
 * @param {(text: string) => number} widthOf [px]
 * @returns {{placed: Placed[], left: number}} and how many were left out for want of room
 */
export function arranged(named, camera, size, choice, widthOf) {
  const origin = projected(camera, size, [0, 0, 0]) ?? [size.width / 2, size.height / 2];
  const most = choice === 'important' ? Math.max(4, Math.floor((size.width * size.height) / CALM)) : Infinity;
  /** @type {Placed[]} */
  const placed = [];
  let left = 0;
  for (const one of named) {
    const tip = projected(camera, size, one.at);
    if (!tip || tip[0] < 0 || tip[1] < 0 || tip[0] > size.width || tip[1] > size.height) continue;
    if (placed.length >= most && one.rank > ABNORMAL.length) {
      left += 1;
      continue;
    }
    const width = widthOf(one.text) + 2 * GAP;
    const spot = spots(tip, origin, width).find(([x, y]) => inside(x, y, width, size) && !placed.some((p) => overlap(p, x, y, width)));
    if (!spot) left += 1;
    else placed.push({ id: one.id, text: one.text, health: one.health, x: spot[0], y: spot[1], width, tip, far: spot[2] > 0 });
  }
  return { placed, left };
}

/** Places to try: outwards from the middle of the scene first, then around the tip, then further off. @param {[number, number]} tip @param {[number, number]} origin @param {number} width @returns {[number, number, number][]} */
function spots([x, y], [ox, oy], width) {
  const out = Math.atan2(y - oy, x - ox);
  const turns = [0, 0.6, -0.6, 1.2, -1.2, 1.9, -1.9, 2.6, -2.6, Math.PI];
  return [0, 14, 30].flatMap((far) => turns.map((turn) => {
    const [c, s] = [Math.cos(out + turn), Math.sin(out + turn)];
    // As far out as the name's own box reaches that way.
    const reach = Math.min((width / 2 + 4) / Math.max(1e-6, Math.abs(c)), (LINE / 2 + 5) / Math.max(1e-6, Math.abs(s))) + far;
    return /** @type {[number, number, number]} */ ([x + reach * c, y + reach * s, far]);
  }));
}

/** @param {number} x @param {number} y @param {number} width @param {Size} size */
function inside(x, y, width, size) {
  return x - width / 2 >= 0 && x + width / 2 <= size.width && y - LINE / 2 >= 0 && y + LINE / 2 <= size.height;
}

/** @param {Placed} p @param {number} x @param {number} y @param {number} width */
function overlap(p, x, y, width) {
  return Math.abs(p.x - x) < (p.width + width) / 2 && Math.abs(p.y - y) < LINE;
}
