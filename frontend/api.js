/**
 * The server's REST interface. Every call can be shown as the curl command that does the same.
 * @import {Call, Experiment, Event, Scenario, Score, Series, SystemDescription, View, Fault} from './types'
 */

const ROOT = '/api/v1';
const KEPT = 40;

/** A refusal (RFC 9457): what was wrong, field by field. */
export class Problem extends Error {
  /** @param {number} status @param {string} message @param {{field: string, message: string}[]} errors */
  constructor(status, message, errors = []) {
    super(message);
    this.status = status;
    this.errors = errors;
  }

  /** @param {string} field */
  about(field) {
    return this.errors.find((error) => error.field === field || error.field.endsWith(`.${field}`))?.message ?? null;
  }
}

/** @type {Call[]} */
export const calls = [];
export const callMade = new EventTarget();

/** Calls that the server has not answered yet. @type {Map<Promise<Response>, string>} */
const open = new Map();

/**
 * Waits until the server has answered all that was asked of an experiment. A browser keeps few calls under way at a time, so one that
 * was made long ago may not even have been sent.
 * @param {string} id
 */
export async function answered(id) {
  const mine = (/** @type {string} */ path) => path === experiment(id) || path.startsWith(`${experiment(id)}/`);
  const left = () => [...open].filter(([, path]) => mine(path)).map(([call]) => call);
  for (let waiting = left(); waiting.length; waiting = left()) await Promise.allSettled(waiting);
}

/**
 * @param {string} method
 * @param {string} path
 * @param {unknown} [body]
 * @param {string} [accept]
 * @returns {Promise<Response>}
 */
function request(method, path, body, accept) {
  const call = asked(method, path, body, accept);
  open.set(call, path);
  return call.finally(() => open.delete(call));
}

/**
 * @param {string} method
 * @param {string} path
 * @param {unknown} [body]
 * @param {string} [accept]
 * @returns {Promise<Response>}
 */
async function asked(method, path, body, accept = 'application/json') {
  /** @type {Record<string, string>} */
  const headers = { accept };
  const form = body instanceof FormData;
  if (body !== undefined && !form) headers['content-type'] = 'application/json';
  const started = performance.now();
  /** @type {Call} */
  const call = { method, path, body, status: null, ms: 0, at: Date.now() };
  if (method !== 'GET') note(call);
  let response;
  try {
    response = await fetch(ROOT + path, { method, headers, body: body === undefined || form ? body : JSON.stringify(body) });
  } catch {
    throw new Problem(0, 'The server does not answer. Is it still running?');
  } finally {
    call.ms = performance.now() - started;
  }
  call.status = response.status;
  if (method !== 'GET') callMade.dispatchEvent(new CustomEvent('call'));
  if (!response.ok) throw await refusal(response);
  return response;
}

/** @param {Call} call */
function note(call) {
  calls.unshift(call);
  calls.length = Math.min(calls.length, KEPT);
}

/** @param {Response} response */
async function refusal(response) {
  let problem;
  try {
    problem = await response.json();
  } catch {
    return new Problem(response.status, `${response.status} ${response.statusText}`);
  }
  /** @type {{pointer?: string, parameter?: string, detail: string}[]} */
  const listed = problem.errors ?? [];
  const errors = listed.map((e) => ({
    field: e.parameter ?? (e.pointer ?? '').replace(/^#\//, '').replaceAll('/', '.'),
    message: e.detail,
  }));
  return new Problem(response.status, problem.detail ?? problem.title ?? response.statusText, errors);
}

/** @param {string} method @param {string} path @param {unknown} [body] @returns {Promise<any>} */
async function json(method, path, body) {
  const response = await request(method, path, body);
  return response.status === 204 ? null : response.json();
}

/** A command for a shell that does what the page does. @param {string} method @param {string} path @param {unknown} [body] */
export function curl(method, path, body) {
  const url = `${location.origin}${ROOT}${path}`;
  const parts = ['curl', ...(method === 'GET' ? [] : ['-X', method]), quoted(url)];
  if (body instanceof FormData) {
    for (const [name, value] of body) parts.push('-F', quoted(`${name}=${value instanceof File ? `@${value.name}` : value}`));
  } else if (body !== undefined) parts.push('-H', quoted('content-type: application/json'), '-d', quoted(JSON.stringify(body)));
  return parts.join(' ');
}

/** @param {string} text */
function quoted(text) {
  return `'${text.replaceAll("'", `'\\''`)}'`;
}

/** @param {string} id */
const experiment = (id) => `/experiments/${encodeURIComponent(id)}`;

/** Paths and bodies of commands, used both to send them and to show them. */
export const commands = {
  /** @param {string} id @param {object} clock @returns {[string, string, object]} */
  clock: (id, clock) => ['PATCH', `${experiment(id)}/clock`, clock],
  /** @param {string} id @param {object} fault @returns {[string, string, object]} */
  inject: (id, fault) => ['POST', `${experiment(id)}/faults`, fault],
  /** @param {string} id @param {string} fault @returns {[string, string]} */
  clear: (id, fault) => ['DELETE', `${experiment(id)}/faults/${encodeURIComponent(fault)}`],
  /** @param {string} id @returns {[string, string]} */
  clearAll: (id) => ['DELETE', `${experiment(id)}/faults`],
  /** @param {string} id @param {string} name @param {boolean} enabled @returns {[string, string, object]} */
  switch: (id, name, enabled) => ['PATCH', `${experiment(id)}/subsystems/${encodeURIComponent(name)}`, { enabled }],
  /** @param {string} id @param {Record<string, unknown>} settings @returns {[string, string, object]} */
  configure: (id, settings) => ['PATCH', `${experiment(id)}/settings`, settings],
  /** @param {string} id @param {number} to @returns {[string, string, object]} */
  rewind: (id, to) => ['POST', `${experiment(id)}/rewind`, { to }],
  /** @param {string} id @param {number} at @param {string} title @returns {[string, string, object]} */
  fork: (id, at, title) => ['POST', `${experiment(id)}/fork`, { at, title }],
  /** @param {string} id @param {object} how @returns {[string, string, object]} */
  advance: (id, how) => ['POST', `${experiment(id)}/advance`, how],
  /** @param {string} id @returns {[string, string]} */
  ghost: (id) => ['POST', `${experiment(id)}/ghost`],
  /** @param {string} system @param {object} choices @returns {[string, string, object]} */
  indicators: (system, choices) => ['POST', `/systems/${encodeURIComponent(system)}/indicators`, choices],
  /** @param {string} id @returns {[string, string]} */
  remove: (id) => ['DELETE', experiment(id)],
  /** @param {string | object} scenario @param {string} [title] @returns {[string, string, object]} */
  create: (scenario, title) => ['POST', '/experiments', { scenario, ...(title && { title }), ...(typeof scenario === 'string' && { spare: true }) }],
  /** @param {FormData} form @returns {[string, string, object]} */
  log: (form) => ['POST', '/logs', form],
};

/** Sends a command of the table above. @param {[string, string, object?]} command @returns {Promise<any>} */
export function send([method, path, body]) {
  return json(method, path, body);
}

export const read = {
  /** @returns {Promise<Scenario[]>} */
  scenarios: () => json('GET', '/scenarios'),
  /** @param {string} id @returns {Promise<SystemDescription>} */
  system: (id) => json('GET', `/systems/${encodeURIComponent(id)}`),
  /** @returns {Promise<import('./types').LogLimits>} */
  logLimits: () => json('GET', '/logs'),
  /** @returns {Promise<Experiment[]>} */
  experiments: () => json('GET', '/experiments'),
  /** @param {string} id @returns {Promise<Experiment>} */
  experiment: (id) => json('GET', experiment(id)),
  /** @param {string} id @returns {Promise<Event[]>} */
  events: (id) => json('GET', `${experiment(id)}/events`),
  /** @param {string} id @returns {Promise<Score>} */
  score: (id) => json('GET', `${experiment(id)}/score`),
  /** @param {string} id @returns {Promise<Record<string, any>>} */
  document: (id) => json('GET', `${experiment(id)}/scenario`),
  /** @param {string} id @param {number} at @returns {Promise<View>} */
  view: (id, at) => json('GET', `${experiment(id)}/view?at=${at}`),
  /** @param {string} id @param {string[]} signals @param {number} [start] @returns {Promise<Series>} */
  series: (id, signals, start) =>
    json('GET', `${seriesPath(id, signals)}${start === undefined ? '' : `&start=${start}`}`),
};

/** @param {string} id @param {string[]} signals */
export function seriesPath(id, signals) {
  return `${experiment(id)}/series?signals=${signals.map(encodeURIComponent).join(',')}`;
}

/** Moves the 3-D scene to a past moment, null is live, and to another of its pictures. @param {string} id @param {number | null} time @param {string} [picture] */
export function moveScene(id, time, picture) {
  return fetch(`${ROOT}${experiment(id)}/cursor`, {
    method: 'PUT',
    headers: { 'content-type': 'application/json' },
    body: JSON.stringify({ time, picture }),
  });
}

/** A file to keep. @param {string} path @param {string} accept @returns {Promise<Blob>} */
export async function file(path, accept) {
  return (await request('GET', path, undefined, accept)).blob();
}

/** @param {string} id */
export const reportAddress = (id) => `${ROOT}${experiment(id)}/report`;
/** @param {string} id */
export const experimentPath = experiment;

/** @param {string} id @param {number | null} since */
export function streamAddress(id, since) {
  const scheme = location.protocol === 'https:' ? 'wss' : 'ws';
  return `${scheme}://${location.host}${ROOT}${experiment(id)}/stream${since === null ? '' : `?since=${since}`}`;
}
