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
 * @property {'auto' | 'base' | 'full'} detail @property {number} [maxLevel]
 * @property {number} [id] of the seek that it answers
 */
/** @typedef {import('./decoder.js').Info & {maxRows: number}} MovieInfo */
/** @typedef {{key: string, bucket: import('./decoder.js').Bucket, detail: number, rows: number}} Held */

const windowSeconds = 1;

/** Views hold lines of 256. @param {number} rows */
const roundedRows = rows => Math.ceil(rows / 256) * 256;

/** @param {{layer: number, bucket: number}} b */
const keyOf = b => `${b.layer}/${b.bucket}`;

export class Session {
  /**
   * @param {WebAssembly.Module} module @param {any} source
   * @param {(message: any, transfer?: Transferable[]) => void} post
   * @param {{cacheBytes?: number, maxRows?: number, tolerant?: boolean, maxMemoryBytes?: number}} [options]
   */
  constructor(module, source, post, options = {}) {
    this.module = module;
    this.post = post;
    this.options = options;
    this.store = new ByteStore(options.cacheBytes);
    this.fetcher = new Fetcher(source, this.store, () => this.#progress());
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
    this.lost = 0;
  }

  /** @param {AbortSignal} [signal] */
  async open(signal = this.control.signal) {
    await this.fetcher.open(signal);
    this.decoder = await Decoder.create(this.module, this.store, this.options);
    await this.fetcher.with(() => this.decoder.open(), signal);
    this.info = this.decoder.info();
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

  /** Sets what is to be shown. A seek cancels what is under way. @param {Goal} goal @param {boolean} seek */
  want(goal, seek) {
    this.goal = goal;
    if (seek) {
      this.control.abort();
      this.control = new AbortController();
    }
    void this.#pump();
  }

  /** Sends everything again: to a view that is new. */
  refresh() {
    this.held.clear();
    if (this.goal) this.want({...this.goal}, true);
  }

  /**
   * @param {number} time @param {{sh?: boolean, detail?: number, maxTier?: number}} options
   * @param {AbortSignal} signal
   */
  async slice(time, options, signal) {
    await this.fetcher.steps(step => this.decoder.windowReads(time, time, options, step), steps.all, signal);
    return this.fetcher.with(() => this.decoder.slice(time, options), signal);
  }

  async #pump() {
    if (this.pumping) return;
    this.pumping = true;
    try {
      /** @type {Goal | null} */
      let done = null;
      while (this.goal !== done && !this.disposed) {
        const goal = /** @type {Goal} */ (this.goal);
        try {
          await this.#reach(goal, this.control.signal);
          done = goal;
        } catch (error) {
          if (this.disposed) return;
          if (/** @type {any} */ (error)?.name === 'AbortError') continue;
          this.post({type: 'error', error: L4DError.toData(error), id: goal.id});
          done = goal;
        }
      }
    } finally {
      this.pumping = false;
    }
  }

  /** @param {Goal} goal @param {AbortSignal} signal */
  async #reach(goal, signal) {
    const begin = Math.min(Math.max(goal.time, this.info.timeBegin), this.end);
    const best = goal.detail === 'base' ? details.base : details.full;
    const local = this.fetcher.source.isLocal;
    const ready = (/** @type {number} */ until, /** @type {number} */ detail) =>
      this.post({type: 'ready', id: goal.id, from: begin, until, detail: detail === details.full ? 'full' : 'base'});
    // Over a network base colours come first: they show the instant with fewer bytes.
    if (best === details.full && !local) {
      await this.#hold(begin, begin, goal, details.base, signal);
      ready(begin, details.base);
    }
    await this.#hold(begin, begin, goal, best, signal);
    ready(begin, best);
    const last = Math.min(begin + goal.ahead, this.end);
    for (let until = begin; until < last && this.goal === goal;) {
      until = Math.min(until + windowSeconds, last);
      await this.#hold(begin, until, goal, best, signal);
      ready(until, best);
    }
    this.#progress(true);
  }

  /**
   * Holds the buckets of [begin, end] in that detail.
   * @param {number} begin @param {number} end @param {Goal} goal @param {number} detail
   * @param {AbortSignal} signal
   */
  async #hold(begin, end, goal, detail, signal) {
    const part = {maxLevel: goal.maxLevel, detail};
    await this.fetcher.steps(step => this.decoder.windowReads(begin, end, part, step), steps.directory, signal);
    const buckets = await this.fetcher.with(() => this.decoder.buckets(begin, end, part), signal);
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
    await this.fetcher.steps(step => this.decoder.bucketReads(wanted, detail, step), steps.all, signal);
    this.#evict(new Set(buckets.map(keyOf)), wanted.reduce((n, b) => n + roundedRows(b.count), 0));
    for (const bucket of wanted) {
      const began = performance.now();
      const rows = await this.fetcher.with(() => this.decoder.rows(bucket.layer, bucket.bucket, detail), signal);
      this.decodeSeconds += (performance.now() - began) / 1000;
      const key = keyOf(bucket);
      this.held.set(key, {key, bucket, detail, rows: rows.count});
      this.post({type: 'rows', key, bucket, detail, ...rows}, [rows.geometry.buffer, rows.sh.buffer]);
      if (signal.aborted) throw abortError();
    }
    this.#losses();
  }

  #losses() {
    const losses = this.decoder.losses();
    if (losses.length === 0) return;
    this.lost += losses.length;
    this.post({type: 'loss', losses});
  }

  /** Makes room for `more` rows. @param {Set<string>} keep @param {number} more */
  #evict(keep, more) {
    let rows = more;
    for (const held of this.held.values()) rows += roundedRows(held.rows);
    for (const held of [...this.held.values()]) {
      if (rows <= this.maxRows) break;
      if (keep.has(held.key)) continue;
      rows -= roundedRows(held.rows);
      this.held.delete(held.key);
      this.post({type: 'removed', key: held.key});
    }
  }

  /** Tells what has come, at most five times a second. */
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
      bytes: this.fetcher.bytes, throughput: this.fetcher.throughput, rows, lost: this.lost,
      requests: this.fetcher.source.requests ?? 0, decodeSeconds: this.decodeSeconds,
      memoryBytes: (this.decoder?.memoryBytes ?? 0) + this.store.bytes
    };
  }

  /**
   * Spans of time, in seconds, whose bytes are here in base colour. @returns {[number, number][]}
   */
  buffered() {
    if (!this.isOpen || !this.goal) return [];
    if (this.fetcher.source.isLocal) return [[this.info.timeBegin, this.end]];
    const cells = 64;
    /** @type {[number, number][]} */
    const spans = [];
    for (let k = 0; k < cells; ++k) {
      const [begin, end] = [k, k + 1].map(i => this.info.timeBegin + this.info.duration * i / cells);
      if (!this.#isBuffered((begin + end) / 2)) continue;
      const last = spans.at(-1);
      if (last && begin - last[1] < 1e-9) last[1] = end;
      else spans.push([begin, end]);
    }
    return spans;
  }

  /** @param {number} time */
  #isBuffered(time) {
    const reads = this.decoder.windowReads(time, time, {detail: details.base}, steps.all);
    return reads !== undefined && reads.every(([offset, size]) => this.store.has(offset, size));
  }
}
