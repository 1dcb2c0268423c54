/** Experiments that this browser has made, kept over visits: only those are its to delete in one go. */

const KEY = 'experiments';
const MOST = 200;

/** @returns {string[]} */
function kept() {
  try {
    const found = JSON.parse(localStorage.getItem(KEY) ?? '[]');
    return Array.isArray(found) ? found.filter((id) => typeof id === 'string') : [];
  } catch {
    return [];
  }
}

/** @param {string} id */
export function claim(id) {
  localStorage.setItem(KEY, JSON.stringify([...kept().filter((one) => one !== id), id].slice(-MOST)));
}

/** @param {string} id */
export function isMine(id) {
  return kept().includes(id);
}
