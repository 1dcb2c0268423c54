/** A link that carries a whole run: scenario, seed, commands, where it stands and where the cursor is. */

const PREFIX = '#run=';

/** @typedef {{scenario: Record<string, any>, time: number, cursor: number | null}} SharedRun */

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
 * The run in an address, if there is one.
 * @param {string} hash
 * @returns {Promise<SharedRun | null>}
 * @throws {Error} the link is damaged
 */
export async function unpack(hash) {
  if (!hash.startsWith(PREFIX)) return null;
  try {
    const text = atob(hash.slice(PREFIX.length).replaceAll('-', '+').replaceAll('_', '/'));
    const bytes = Uint8Array.from(text, (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate-raw'));
    const run = JSON.parse(await new Response(stream).text());
    return { scenario: run.scenario, time: Number(run.time) || 0, cursor: typeof run.cursor === 'number' ? run.cursor : null };
  } catch {
    throw new Error('This link is damaged: it does not hold a whole run. Ask for it again.');
  }
}
