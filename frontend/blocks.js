/** Words in a block of the diagram: name and state in as many lines and as small letters as it takes, so that nothing is cut. */

/** @typedef {{name: string[], nameSize: number, squeezed: boolean, state: string[], stateSize: number, cut: boolean}} Words */

export const LEFT = 7;
const RIGHT = 4;
const NAME_SIZES = [11.5, 10.5, 9.5, 9];
const STATE_SIZES = [10, 9.5, 9, 8.5];
/** How far a name may be narrowed before it takes a second line. */
const NARROWEST = 0.8;
/** Space between lines, and above and below all of them [px]. */
export const LEADING = 1.6;
const PADDING = 4;
const FAMILY = 'system-ui, "DejaVu Sans", sans-serif';

const measure = /** @type {CanvasRenderingContext2D} */ (document.createElement('canvas').getContext('2d'));
/** @type {Map<string, Words>} */
const known = new Map();

/** @param {string} text @param {string} font weight and size */
function widthOf(text, font) {
  measure.font = `${font} ${FAMILY}`;
  return measure.measureText(text).width;
}

/**
 * @param {string} name
 * @param {string} state
 * @param {number} width of the block [px]
 * @param {number} height of the block [px]
 * @returns {Words}
 */
export function worded(name, state, width, height) {
  const key = `${Math.round(width)}/${Math.round(height)}/${name}/${state}`;
  let words = known.get(key);
  if (!words) {
    words = composed(name, state, width - LEFT - RIGHT, height - 2 * PADDING);
    if (known.size > 2000) known.clear();
    known.set(key, words);
  }
  return words;
}

/** @param {string} name @param {string} state @param {number} width @param {number} height @returns {Words} */
function composed(name, state, width, height) {
  const title = titled(name, width);
  const used = title.name.length * (title.nameSize + LEADING);
  for (const stateSize of STATE_SIZES) {
    const lines = wrapped(state, width, `${stateSize}px`);
    if (used + lines.length * (stateSize + LEADING) <= height) return { ...title, state: lines, stateSize, cut: false };
  }
  const stateSize = STATE_SIZES[STATE_SIZES.length - 1];
  const lines = wrapped(state, width, `${stateSize}px`);
  const most = Math.max(1, Math.floor((height - used) / (stateSize + LEADING)));
  // A block too low for its name, without a state, has nothing that could be cut.
  if (lines.length <= most) return { ...title, state: lines, stateSize, cut: false };
  const shown = lines.slice(0, most);
  shown[most - 1] = `${shown[most - 1].slice(0, -1)}…`;
  return { ...title, state: shown, stateSize, cut: true };
}

/** @param {string} name @param {number} width */
function titled(name, width) {
  for (const nameSize of NAME_SIZES) if (widthOf(name, `600 ${nameSize}px`) <= width) return { name: [name], nameSize, squeezed: false };
  const nameSize = NAME_SIZES[1];
  if (widthOf(name, `600 ${NAME_SIZES[2]}px`) * NARROWEST <= width) return { name: [name], nameSize: NAME_SIZES[2], squeezed: true };
  return { name: wrapped(name.replaceAll('/', '/\u200b'), width, `600 ${nameSize}px`), nameSize, squeezed: false };
}

/** A text over lines; a word that is wider than a line is parted. @param {string} text @param {number} width @param {string} font @returns {string[]} */
function wrapped(text, width, font) {
  /** @type {string[]} */
  const lines = [];
  let line = '';
  for (const [part] of text.matchAll(/[^ \u200b]+[ \u200b]?/g)) {
    const word = part.trimEnd().replace('\u200b', '');
    const joint = line && !line.endsWith('/') ? ' ' : '';
    if (line && widthOf(line + joint + word, font) <= width) line += joint + word;
    else {
      if (line) lines.push(line);
      line = word;
    }
    while (widthOf(line, font) > width && line.length > 4) {
      let fits = line.length - 3;
      while (fits > 2 && widthOf(`${line.slice(0, fits)}-`, font) > width) fits -= 1;
      lines.push(`${line.slice(0, fits)}-`);
      line = line.slice(fits);
    }
  }
  return line ? [...lines, line] : lines;
}
