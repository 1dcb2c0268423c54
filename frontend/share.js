/** A link that carries a whole run: scenario, seed, commands, where it stands, where the cursor is, and how the page shows it. */

const PREFIX = '#run=';
/** A title or name that is longer is none. */
const LONGEST = 120;

/**
 * @typedef {object} SharedRun
 * @property {Record<string, any>} scenario
 * @property {number} time where it stands [s]
 * @property {number | null} cursor
 * @property {string[] | null} charts those shown; null in a link from before they were in it
 * @property {[number, number] | null} zoom
 * @property {number | null} follow the window of the charts [s]
 * @property {string | null} title of the experiment, where it is not the scenario's
 * @property {'dark' | 'light' | null} theme
 * @property {string | null} picture the one that the scene shows; null: the first
 * @property {boolean} large whether the scene is at full size
 */

/** @param {SharedRun} run @returns {Promise<string>} */
export async function link(run) {
  const packed = new Blob([JSON.stringify(run)]).stream().pipeThrough(new CompressionStream('deflate-raw'));
  const bytes = new Uint8Array(await new Response(packed).arrayBuffer());
  let text = '';
  for (const byte of bytes) text += String.fromCharCode(byte);
  const coded = btoa(text).replaceAll('+', '-').replaceAll('/', '_').replaceAll('=', '');
  return `${location.origin}${location.pathname}${PREFIX}${coded}`;
}

/**
 * The run that an address carries.
 * @param {string} hash
 * @returns {Promise<SharedRun>}
 * @throws {Error} the link is damaged
 */
export async function unpack(hash) {
  try {
    const packed = atob(hash.slice(PREFIX.length).replaceAll('-', '+').replaceAll('_', '/'));
    const bytes = Uint8Array.from(packed, (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate-raw'));
    const run = JSON.parse(await new Response(stream).text());
    if (typeof run.scenario !== 'object' || !run.scenario) throw new Error('no scenario');
    const number = (/** @type {unknown} */ value) => (typeof value === 'number' && Number.isFinite(value) ? value : null);
    const text = (/** @type {unknown} */ value) => (typeof value === 'string' && value.length <= LONGEST ? value : null);
    const zoom = Array.isArray(run.zoom) && run.zoom.length === 2 && run.zoom.every((/** @type {unknown} */ t) => number(t) !== null) ? run.zoom : null;
    return {
      scenario: run.scenario, time: number(run.time) ?? 0, cursor: number(run.cursor), zoom, follow: number(run.follow),
      charts: Array.isArray(run.charts) ? run.charts.map(String) : null,
      title: text(run.title), picture: text(run.picture), theme: run.theme === 'dark' || run.theme === 'light' ? run.theme : null, large: run.large === true,
    };
  } catch {
    throw new Error('This link is damaged: it does not hold a whole run. Ask for it again, and copy all of it.');
  }
}
