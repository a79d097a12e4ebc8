// SPDX-License-Identifier: Apache-2.0
// A stream that is being shown: which buckets there are, which are wanted, what comes next. Runs in a
// worker; knows nothing of pages.
import {abortError, L4DError} from './errors.js';
import {Decoder, details, steps} from './decoder.js';
import {Fetcher} from './fetcher.js';
import {ByteStore} from './store.js';

/**
 * @typedef {object} Goal what is to be shown
 * @property {number} time seconds @property {number} ahead seconds from there
 * @property {'auto' | 'base' | 'full'} detail @property {number} [maxLevel] @property {number} [maxTier]
 * @property {boolean} [playing] what comes next is wanted before all of this instant
 * @property {number} [rate] of playback
 * @property {number} [most] the highest rung that may be fetched, where others are to come first
 * @property {number} [id] of the seek that it answers
 * @property {number} [turn] counts seeks and changes of what is shown; `ready` and `error` repeat it
 */
/**
 * What is fetched and shown; each rung of a ladder contains the one before it.
 * @typedef {{maxTier: number, detail: number}} Rung
 */
/** @typedef {import('./decoder.js').Info & {maxRows: number}} MovieInfo */
/** @typedef {{key: string, bucket: import('./decoder.js').Bucket, detail: number, rows: number}} Held */

const windowSeconds = 1;
const leastBuffered = 3;  // seconds of the rung that is shown; with less, nothing is fetched of higher ones
const mostIndexBytes = 512 * 1024;  // of a directory, to be fetched before it is wanted

/** Views hold lines of 256. @param {number} rows */
export const roundedRows = rows => Math.ceil(rows / 256) * 256;

/** @param {{layer: number, bucket: number}} b */
const keyOf = b => `${b.layer}/${b.bucket}`;

export class Session {
  /**
   * @param {WebAssembly.Module | Promise<WebAssembly.Module> | WebAssembly.Instance} module @param {any} source
   * @param {(message: any, transfer?: Transferable[]) => void} post
   * @param {{cacheBytes?: number, maxRows?: number, tolerant?: boolean, maxMemoryBytes?: number, acceptNeeds?: boolean,
   *   room?: (rows: number) => void, onIdle?: () => void,
   *   onTransfer?: (sent: number, first: number, last: number, bytes: number) => void}} [options]
   * room: is called before so many rows come; onIdle: nothing is left to fetch; onTransfer: measures the link instead
   */
  constructor(module, source, post, options = {}) {
    this.module = module;
    this.post = post;
    this.options = options;
    this.store = new ByteStore(options.cacheBytes);
    this.fetcher = new Fetcher(source, this.store, () => this.#progress(),
                               options.onTransfer ?? ((...transfer) => this.decoder?.addTransfer(...transfer)));
    this.throughput = 0;  // bits a second, of late
    this.holding = 0;     // the rung that is being fetched
    this.hasIndex = false;
    /** @type {{goal: Goal, message: any} | null} */
    this.lastReady = null;
    /** @type {Map<string, Held>} */
    this.held = new Map();
    this.maxRows = options.maxRows ?? 2 ** 21;
    /** @type {Goal | null} */
    this.goal = null;
    this.pumping = false;
    this.disposed = false;
    this.isOpen = false;
    this.control = new AbortController();
    // Set by open().
    this.decoder = /** @type {Decoder} */ (/** @type {unknown} */ (null));
    this.info = /** @type {import('./decoder.js').Info} */ (/** @type {unknown} */ (null));
    this.end = 0;
    this.lastProgress = 0;
    this.decodeSeconds = 0;
    /** @type {Set<string>} parts of the stream that have been reported as lost */
    this.lost = new Set();
  }

  /** Runs fn; what it uses of the file stays here meanwhile. @template T @param {() => Promise<T>} fn */
  async #whileHeld(fn) {
    const release = this.store.hold();
    try {
      return await fn();
    } finally {
      release();
    }
  }

  /** @param {AbortSignal} [signal] */
  open(signal = this.control.signal) { return this.#whileHeld(() => this.#open(signal)); }

  /** @param {AbortSignal} signal */
  async #open(signal) {
    // The caller that compiles the module reports its errors, whatever the source does meanwhile.
    const [module] = await Promise.all([this.module, this.fetcher.open(signal)]);
    // Its own cache has nothing to do with that of the file.
    const {cacheBytes, ...options} = this.options;
    const decoder = await Decoder.create(module, this.store, options);
    await this.fetcher.with(() => decoder.open(), signal);
    this.info = decoder.info();
    decoder.beginRate(this.info.lastTier + 2);
    this.decoder = decoder;
    this.end = this.info.timeBegin + this.info.duration;
    this.isOpen = true;
    // Not more than the scene can fill.
    this.maxRows = Math.min(this.maxRows, roundedRows(2 * this.info.numGaussians + 65536));
    return {...this.info, maxRows: this.maxRows};
  }

  dispose() {
    this.disposed = true;
    this.control.abort();
    this.fetcher.source.close?.();
    this.decoder?.dispose();
    this.held.clear();
  }

  /**
   * Sets what is to be shown. A seek cancels what is under way, unless that is for the same instant.
   * @param {Goal} goal @param {boolean} seek
   */
  want(goal, seek) {
    const before = this.goal;
    const keys = /** @type {const} */ (['time', 'detail', 'maxLevel', 'maxTier']);
    if (seek && before && keys.every(key => before[key] === goal[key])) {
      Object.assign(before, goal);
      if (this.lastReady?.goal === before) this.post({...this.lastReady.message, id: goal.id, turn: goal.turn});
    } else {
      this.goal = goal;
      if (seek || this.#isTooMuch(goal)) this.#cancel();
    }
    void this.#pump();
  }

  #cancel() {
    this.control.abort();
    this.control = new AbortController();
  }

  /** Fetches and decodes no more, until something is wanted again. */
  rest() {
    if (!this.goal) return;
    this.goal = this.lastReady = null;
    this.#cancel();
  }

  /** Rests, and takes its rows back. */
  drop() {
    this.rest();
    for (const key of this.held.keys()) this.post({type: 'removed', key});
    this.held.clear();
  }

  /** Rows that a view holds of it. */
  get heldRows() {
    let rows = 0;
    for (const held of this.held.values()) rows += roundedRows(held.rows);
    return rows;
  }

  /** Sends everything again: to a view that is new. */
  refresh() {
    if (this.held.size === 0 || !this.goal) return;
    this.held.clear();
    this.goal = {...this.goal};
    this.#cancel();
    void this.#pump();
  }

  /**
   * @param {number} time @param {{sh?: boolean, detail?: number, maxTier?: number}} options
   * @param {AbortSignal} signal
   */
  slice(time, options, signal) {
    return this.#whileHeld(async () => {
      await this.fetcher.steps(step => this.decoder.windowReads(time, time, options, step), steps.all, signal);
      return this.fetcher.with(() => this.#telling(this.decoder.slice(time, options)), signal);
    });
  }

  async #pump() {
    if (this.pumping) return;
    this.pumping = true;
    try {
      /** @type {Goal | null} */
      let done = null;
      while (this.goal && this.goal !== done && !this.disposed) {
        const {goal} = this;
        try {
          await this.#whileHeld(() => this.#reach(goal, this.control.signal));
          done = goal;
        } catch (error) {
          if (this.disposed) return;
          if (/** @type {any} */ (error)?.name === 'AbortError') continue;
          this.post({type: 'error', error: L4DError.toData(error), id: goal.id, turn: goal.turn});
          done = goal;
        }
      }
    } finally {
      this.pumping = false;
    }
    if (!this.disposed) this.options.onIdle?.();
  }

  /** The ladder of a goal, lowest rung first. @param {Goal} goal @returns {Rung[]} */
  #rungs({detail, maxTier = this.info.lastTier}) {
    const last = Math.min(maxTier, this.info.lastTier);
    /** @type {Rung[]} */
    const rungs = Array.from({length: last + 1}, (_, tier) => ({maxTier: tier, detail: details.base}));
    if (detail !== 'base') rungs.push({maxTier: last, detail: details.full});
    // From memory all of it comes at once.
    return this.fetcher.source.isLocal ? rungs.slice(-1) : rungs;
  }

  /** @param {Goal} goal @returns {[number, number]} what of the sequence it is about */
  #span({time, ahead}) {
    const begin = Math.min(Math.max(time, this.info.timeBegin), this.end);
    return [begin, Math.min(begin + ahead, this.end)];
  }

  /** Says how much of the instant is here, and until when the lowest rung is. @param {Goal} goal @param {Rung[]} rungs */
  #ready(goal, rungs) {
    const [begin, last] = this.#span(goal);
    let rung = 0, until = begin;
    while (rung + 1 < rungs.length && this.#holds(begin, begin, goal, rungs[rung + 1])) ++rung;
    while (until < last && this.#holds(until, Math.min(until + windowSeconds / 2, last), goal, rungs[0])) {
      until = Math.min(until + windowSeconds / 2, last);
    }
    const message = {type: 'ready', id: goal.id, turn: goal.turn, from: begin, until, tier: rungs[rung].maxTier,
                     detail: rungs[rung].detail === details.full ? 'full' : 'base'};
    this.lastReady = {goal, message};
    this.post(message);
  }

  /** @param {Goal} goal @param {AbortSignal} signal */
  async #reach(goal, signal) {
    const [begin, last] = this.#span(goal);
    const rungs = this.#rungs(goal);
    const top = Math.min(rungs.length - 1, goal.most ?? Infinity);
    // The instant, coarse first: that shows it with the fewest bytes.
    for (this.holding = 0; this.holding <= top && !(this.holding > 0 && goal.playing); ++this.holding) {
      await this.#hold(begin, begin, goal, rungs[this.holding], signal);
      this.#ready(goal, rungs);
    }
    // Who pauses may seek next.
    if (!goal.playing && !this.hasIndex) await this.#wholeIndex(signal);
    if (last > begin) {
      await this.#index(begin, last, signal);
      this.#ready(goal, rungs);
    }
    while (this.goal === goal) {
      const next = this.#next(goal, rungs);
      if (!next) break;
      this.holding = next.rung;
      await this.#hold(begin, next.until, goal, rungs[next.rung], signal);
      this.#ready(goal, rungs);
    }
    this.#progress(true);
    if (this.goal === goal && !this.hasIndex) await this.#wholeIndex(signal);
  }

  /**
   * What to fetch next: the first second that a rung lacks.
   * @param {Goal} goal @param {Rung[]} rungs @returns {{rung: number, until: number} | null} null: nothing lacks
   */
  #next(goal, rungs) {
    const top = Math.min(rungs.length - 1, goal.most ?? Infinity);
    const choice = this.#choose(goal, rungs);
    const [begin, last] = this.#span(goal);
    for (let rung = goal.playing ? Math.min(choice?.rung ?? 0, top) : top; rung <= top; ++rung) {
      for (let until = begin; until < last;) {
        // It plays as soon as the first of them is here.
        until = Math.min(until + (until === begin ? windowSeconds / 2 : windowSeconds), last);
        if (!this.#holds(begin, until, goal, rungs[rung])) return {rung, until};
      }
    }
    return null;
  }

  /** Buckets of [begin, end] that are not held in a rung; undefined: not known yet. @param {number} begin @param {number} end @param {Goal} goal @param {Rung} rung */
  #lacking(begin, end, {maxLevel}, {maxTier, detail}) {
    return this.decoder.buckets(begin, end, {maxLevel, maxTier})?.filter(b =>
      b.count > 0 && (this.held.get(keyOf(b))?.detail ?? Infinity) > detail);
  }

  /** @param {number} begin @param {number} end @param {Goal} goal @param {Rung} rung */
  #holds(begin, end, goal, rung) { return this.#lacking(begin, end, goal, rung)?.length === 0; }

  /** Bytes that a rung lacks; undefined: not known yet. @param {number} begin @param {number} end @param {Goal} goal @param {Rung} rung */
  #missing(begin, end, goal, rung) {
    const lacking = this.#lacking(begin, end, goal, rung);
    const reads = lacking && this.decoder.bucketReads(lacking, rung.detail, steps.all);
    return reads && this.fetcher.missingBytes(reads);
  }

  /**
   * What the controller of the rate (include/l4d/rate.h) says; undefined: too little is known.
   * @param {Goal} goal @param {Rung[]} rungs
   */
  #choose(goal, rungs) {
    if (this.fetcher.source.isLocal) return undefined;
    const [begin, last] = this.#span(goal);
    const rate = Math.max(Math.abs(goal.rate ?? 1), 0.01);
    /** @type {{buffered: number, missing: number}[]} */
    const states = [];
    for (const rung of rungs) {
      const missing = this.#missing(begin, last, goal, rung);
      if (missing === undefined) return undefined;
      let until = begin;
      if (missing === 0) until = last;
      for (let to = begin; missing > 0 && to < last; until = to) {
        to = Math.min(to + windowSeconds / 2, last);
        if (this.#missing(begin, to, goal, rung) !== 0) break;
      }
      states.push({buffered: missing === 0 && last === this.end ? Infinity : (until - begin) / rate, missing});
    }
    // The ladder of all that there is has as many rungs as the controller knows of.
    while (states.length < this.info.lastTier + 2) states.push({...states[states.length - 1]});
    const choice = this.decoder.chooseRung(states);
    this.fetcher.mergeGap = choice.mergeGap;
    this.fetcher.maxBytes = Math.min(choice.maxRangeBytes, 512 * 1024);
    this.throughput = 8 * choice.throughput;
    const rung = Math.min(choice.rung, rungs.length - 1);
    return {...choice, rung, buffered: states[rung].buffered};
  }

  /**
   * Whether what is under way keeps a goal that plays from what it needs sooner. What has come of it stays.
   * @param {Goal} goal
   */
  #isTooMuch(goal) {
    if (!goal.playing || !this.pumping || !this.isOpen || this.holding === 0) return false;
    const choice = this.#choose(goal, this.#rungs(goal));
    return choice !== undefined && choice.rung < this.holding && (choice.cancel > 0 || choice.buffered < leastBuffered);
  }

  /** The directory of [begin, end]. @param {number} begin @param {number} end @param {AbortSignal} signal */
  async #index(begin, end, signal) {
    await this.fetcher.steps(step => this.decoder.windowReads(begin, end, {}, step), steps.directory, signal);
  }

  /** The directory of all of the sequence, so that a seek is one round. @param {AbortSignal} signal */
  async #wholeIndex(signal) {
    const {timeBegin} = this.info;
    try {
      const entries = (/** @type {number} */ step) => this.decoder.windowReads(timeBegin, this.end, {}, step);
      await this.fetcher.steps(entries, steps.pageTables, signal);
      const pages = await this.fetcher.with(() => entries(steps.directory), signal);
      const most = Math.min(mostIndexBytes, this.store.budget / 4);
      if (this.fetcher.missingBytes(pages) <= most) await this.fetcher.fetch(pages, signal);
      this.hasIndex = true;
    } catch (error) {
      // Nobody has requested it yet: a later request reports the error.
      if (/** @type {any} */ (error)?.name === 'AbortError') throw error;
    }
  }

  /**
   * Holds the buckets of [begin, end] as a rung has them. Decodes each as soon as its bytes are here.
   * @param {number} begin @param {number} end @param {Goal} goal @param {Rung} rung
   * @param {AbortSignal} signal
   */
  async #hold(begin, end, goal, {maxTier, detail}, signal) {
    const part = {maxLevel: goal.maxLevel, maxTier, detail};
    await this.fetcher.steps(step => this.decoder.windowReads(begin, end, part, step), steps.directory, signal);
    const buckets = await this.fetcher.with(() => this.#telling(this.decoder.buckets(begin, end, part)), signal);
    const wanted = buckets.filter(b => {
      const held = this.held.get(keyOf(b));
      if (held) {
        this.held.delete(held.key);
        this.held.set(held.key, held);
      }
      // What is there in full is good for base too.
      return b.count > 0 && (!held || held.detail > detail);
    });
    if (wanted.length === 0) return;
    this.#evict(new Set(buckets.map(keyOf)), wanted.reduce((n, b) => n + roundedRows(b.count), 0));
    await this.fetcher.steps(step => this.decoder.bucketReads(wanted, detail, step), steps.directory, signal);
    const parts = [];
    for (const bucket of wanted) {
      parts.push({bucket, ranges: await this.fetcher.with(() => this.decoder.bucketReads([bucket], detail, steps.all), signal)});
    }
    // Somebody waits for an instant.
    const fetching = this.fetcher.fetch(parts.flatMap(p => p.ranges), signal, begin === end && this.holding === 0);
    for await (const {bucket} of this.fetcher.arrivals(parts, fetching)) {
      const began = performance.now();
      const rows = await this.fetcher.with(() => this.#telling(this.decoder.rows(bucket.layer, bucket.bucket, detail)), signal);
      this.decodeSeconds += (performance.now() - began) / 1000;
      const key = keyOf(bucket);
      this.held.set(key, {key, bucket, detail, rows: rows.count});
      this.post({type: 'rows', key, stream: 0, bucket, detail, ...rows}, [rows.geometry.buffer, rows.sh.buffer]);
      if (signal.aborted) throw abortError();
    }
    await fetching;
  }

  /** Reports what a call of the decoder has lost, if it is new. @template T @param {T} result of the call @returns {T} */
  #telling(result) {
    if (result === undefined) return result;
    const losses = this.decoder.losses().filter(({code, layer, bucket, offset, detailOnly}) => {
      // A page of the directory begins at the first bucket that a query wants of it.
      const key = [code, layer, offset >= 0 ? offset : `bucket ${bucket}`, detailOnly].join();
      return !this.lost.has(key) && this.lost.add(key);
    });
    if (losses.length > 0) this.post({type: 'loss', losses});
    return result;
  }

  /** Makes room for `more` rows. @param {Set<string>} keep @param {number} more */
  #evict(keep, more) {
    this.options.room?.(more);
    let rows = more + this.heldRows;
    for (const held of [...this.held.values()]) {
      if (rows <= this.maxRows) break;
      if (keep.has(held.key)) continue;
      rows -= roundedRows(held.rows);
      this.held.delete(held.key);
      this.post({type: 'removed', key: held.key});
    }
  }

  /** Reports what has come, at most five times a second. */
  #progress(always = false) {
    const now = performance.now();
    if (!always && now - this.lastProgress < 200) return;
    this.lastProgress = now;
    this.post({type: 'progress', ...this.statistics(), buffered: this.buffered()});
  }

  statistics() {
    let rows = 0;
    for (const held of this.held.values()) rows += held.rows;
    return {
      bytes: this.fetcher.bytes, throughput: this.throughput, rows, lost: this.lost.size,
      requests: this.fetcher.source.requests ?? 0, decodeSeconds: this.decodeSeconds,
      memoryBytes: (this.decoder?.memoryBytes ?? 0) + this.store.bytes
    };
  }

  /**
   * Spans of time, in seconds, whose bytes are here as the lowest rung wants them. @returns {[number, number][]}
   */
  buffered() {
    if (!this.isOpen || !this.goal) return [];
    if (this.fetcher.source.isLocal) return [[this.info.timeBegin, this.end]];
    const cells = 64;
    /** @type {[number, number][]} */
    const spans = [];
    for (let k = 0; k < cells; ++k) {
      const [begin, end] = [k, k + 1].map(i => this.info.timeBegin + this.info.duration * i / cells);
      if (!this.isBuffered((begin + end) / 2)) continue;
      const last = spans.at(-1);
      if (last && begin - last[1] < 1e-9) last[1] = end;
      else spans.push([begin, end]);
    }
    return spans;
  }

  /** Whether the lowest rung of an instant is here. @param {number} time */
  isBuffered(time) {
    if (!this.isOpen) return false;
    const reads = this.decoder.windowReads(time, time, {maxTier: 0, detail: details.base}, steps.all);
    return reads !== undefined && reads.every(([offset, size]) => this.store.has(offset, size));
  }
}
