// SPDX-License-Identifier: Apache-2.0
// A member of a presentation that is open: a session of its own stream, in its own time.
import {L4DError} from './errors.js';
import {Session} from './session.js';
import {HttpSource} from './sources.js';

/** Times that differ by less are roundings of one. */
export const slack = 1e-6;

/** The server does not have it, or not yet. */
const absences = ['NOT_FOUND', 'HTTP'];
/** What is wrong with a stream, not with its way here. */
const damages = [...absences, 'CORRUPT', 'CHECKSUM', 'TRUNCATED', 'NOT_L4D', 'VERSION_UNSUPPORTED', 'FEATURE_UNSUPPORTED',
                 'LIMIT_EXCEEDED'];

/**
 * @typedef {object} Host what a part belongs to
 * @property {WebAssembly.Instance} instance
 * @property {any} options of the presentation
 * @property {import('./link.js').Link} link
 * @property {(part: Part, message: any, transfer?: Transferable[]) => void} receive messages of its session
 * @property {(part: Part, rows: number) => void} room
 * @property {(...transfer: [number, number, number, number]) => void} transferred
 * @property {() => void} changed something has come
 */

export class Part {
  /** @param {import('./playlist.js').Member} entry @param {Host} host */
  constructor(entry, host) {
    this.entry = entry;
    this.host = host;
    const {url, offset, bytes} = entry;
    const source = new HttpSource(url, {link: host.link, part: bytes > 0 ? {offset, bytes} : undefined});
    this.session = new Session(host.instance, source, (message, transfer) => host.receive(this, message, transfer), {
      ...host.options, maxRows: undefined, acceptNeeds: true, room: rows => host.room(this, rows),
      onIdle: host.changed, onTransfer: host.transferred
    });
    /** Set by open(). @type {import('./decoder.js').Info | null} */
    this.info = null;
    /** The last message 'ready' of the session. @type {any} */
    this.ready = null;
    /** @type {L4DError | null} why it shows nothing */
    this.damage = null;
    this.isTold = false;     // that it is lost
    this.lastUsed = 0;
    this.wanted = '';
    this.isMet = false;      // the presentation knows what it says of itself
    this.hasFailed = false;  // its bytes do not come
    this.users = 0;          // calls that need it open
    /** @type {Promise<void> | null} */
    this.opening = null;
  }

  /** Opens it once; another time where that has failed. @param {AbortSignal} [signal] */
  open(signal) {
    return this.opening ??= this.#open(signal).catch(error => {
      this.opening = null;
      throw error;
    });
  }

  /** @param {AbortSignal} [signal] */
  async #open(signal) {
    try {
      this.info = await this.session.open(signal);
    } catch (error) {
      if (!this.lose(error)) throw error;
    }
  }

  /** Goes on without it, if `error` costs no more than its span. Returns whether that is so. @param {unknown} error */
  lose(error) {
    if (!(error instanceof L4DError) || !damages.includes(error.code) || this.host.options.tolerant === false) return false;
    this.damage = error;
    return true;
  }

  /** Whether its server did not have it when it was wanted. */
  get isAbsent() { return this.damage !== null && absences.includes(this.damage.code); }

  /** Tries once more to get what its server did not have. */
  retry() {
    if (!this.isAbsent) return;
    this.damage = null;
    this.wanted = '';
    if (this.info) return;
    this.opening = null;
    this.isMet = false;
  }

  /**
   * Wants what `goal` says, in its own time.
   * @param {import('./session.js').Goal} goal times of the presentation @param {boolean} seek
   */
  want(goal, seek) {
    const wanted = JSON.stringify(goal);
    if (wanted === this.wanted && !seek) return;
    this.wanted = wanted;
    this.session.want({...goal, time: goal.time - this.entry.shift}, seek);
  }

  rest() {
    this.wanted = '';
    this.session.rest();
  }

  /** Takes its rows back. */
  drop() {
    this.wanted = '';
    this.ready = null;
    this.session.drop();
  }

  /** Until when its lowest rung is here, from a time on, in seconds of the presentation. @param {number} time @param {number} id of the seek */
  until(time, id) {
    if (this.damage) return Infinity;
    const {ready, entry: {shift}} = this;
    if (!ready || ready.id !== id || !this.info) return -Infinity;
    if (time < ready.from + shift - slack) {
      // What is before its own sequence is shown as the begin of it.
      if (time > this.info.timeBegin + shift || ready.from > this.info.timeBegin + slack) return -Infinity;
    }
    // So it is behind its end.
    const end = this.info.timeBegin + this.info.duration;
    return ready.until >= end - slack ? Infinity : ready.until + shift;
  }

  /** The rung of its instant; Infinity: as much as it has. */
  get tier() { return this.damage || this.ready?.tier >= (this.info?.lastTier ?? 0) ? Infinity : this.ready.tier; }

  get isIdle() { return this.damage !== null || this.info !== null && !this.session.pumping; }

  /** @param {number} time of the presentation */
  isBuffered(time) { return this.damage !== null || this.session.isBuffered(time - this.entry.shift); }

  close() { this.session.dispose(); }
}
