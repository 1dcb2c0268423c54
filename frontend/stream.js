/**
 * The live connection of one experiment: resumes by itself where it left off, acknowledges what it drew.
 * @import {Event, Experiment, Series, View} from './types'
 */
import { streamAddress } from './api.js';

/**
 * @typedef {object} Listener
 * @property {(experiment: Experiment) => void} state
 * @property {(series: Series) => void} frames
 * @property {(event: Event) => void} event
 * @property {(view: View) => void} view
 * @property {(time: number) => void} reset the experiment was rewound: what came after `time` never happened
 * @property {(link: 'connecting' | 'open' | 'lost' | 'gone', again: boolean) => void} link
 */

/** Close codes: no such experiment, or it was deleted. */
const GONE = [4404, 4410];
const LONGEST_WAIT = 4000;

export class Stream {
  /** @type {WebSocket | null} */
  #socket = null;
  #closed = false;
  #attempt = 0;
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  #timer;
  /** @type {string[]} */
  #signals = [];
  /** @type {() => number | null} */
  #since;

  /**
   * @param {string} id
   * @param {Listener} listener
   * @param {() => number | null} since time up to which data are here already
   */
  constructor(id, listener, since) {
    this.id = id;
    this.listener = listener;
    this.#since = since;
    this.#connect();
  }

  /** @param {string[]} signals */
  subscribe(signals) {
    this.#signals = signals;
    this.#say({ type: 'subscribe', signals });
  }

  close() {
    this.#closed = true;
    clearTimeout(this.#timer);
    this.#socket?.close();
  }

  #connect() {
    const again = this.#attempt > 0;
    this.listener.link(again ? 'lost' : 'connecting', again);
    const socket = new WebSocket(streamAddress(this.id, again ? this.#since() : null));
    this.#socket = socket;
    socket.onmessage = (message) => {
      if (!this.#closed) this.#hear(JSON.parse(message.data), again);
    };
    socket.onclose = (close) => {
      if (this.#closed) return;
      if (GONE.includes(close.code)) {
        this.listener.link('gone', again);
        return;
      }
      this.listener.link('lost', again);
      this.#attempt += 1;
      this.#timer = setTimeout(() => this.#connect(), Math.min(LONGEST_WAIT, 250 * 2 ** Math.min(this.#attempt, 5)));
    };
  }

  /** @param {any} message @param {boolean} again */
  #hear(message, again) {
    const { type, ...rest } = message;
    switch (type) {
      case 'hello':
        this.#attempt = 1;
        this.#say({ type: 'subscribe', signals: this.#signals });
        this.listener.link('open', again);
        this.listener.state(rest.experiment);
        break;
      case 'state':
        this.listener.state(rest);
        break;
      case 'frames':
        this.listener.frames(rest);
        if (rest.time.length) this.#say({ type: 'ack', time: rest.time.at(-1) });
        break;
      case 'event':
        this.listener.event(rest);
        break;
      case 'reset':
        this.listener.reset(rest.time);
        break;
      case 'view':
        this.listener.view(rest);
        break;
    }
  }

  /** @param {object} message */
  #say(message) {
    if (this.#socket?.readyState === WebSocket.OPEN) this.#socket.send(JSON.stringify(message));
  }
}
