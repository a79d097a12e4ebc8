// SPDX-License-Identifier: Apache-2.0
import {abortError} from './errors.js';
import {steps} from './decoder.js';

const parallel = 6;          // requests in flight: as many connections as browsers open

/** Seconds. */
const now = () => performance.now() / 1000;

/** Brings bytes from a source to a store, and runs what needs them. */
export class Fetcher {
  /**
   * @param {any} source sources.js @param {import('./store.js').ByteStore} store
   * @param {() => void} [onProgress]
   * @param {(sent: number, first: number, last: number, bytes: number) => void} [onTransfer] of a request that has
   * ended, times in seconds
   */
  constructor(source, store, onProgress = () => {}, onTransfer = () => {}) {
    this.source = source;
    this.store = store;
    this.onProgress = onProgress;
    this.onTransfer = onTransfer;
    this.bytes = 0;         // that have come
    // How requests are cut: pieces this close become one, and none is longer.
    this.mergeGap = 16 * 1024;
    this.maxBytes = 512 * 1024;
    /** @type {(() => void)[]} */
    this.waiting = [];
  }

  /** Opens the source. @param {AbortSignal} signal */
  async open(signal) {
    this.store.size = await this.source.open(signal);
    // What comes once cannot be fetched again.
    if (this.source.isWhole) this.store.budget = Infinity;
    this.source.begin?.((/** @type {number} */ offset, /** @type {Uint8Array} */ bytes) =>
      this.#keep(offset, bytes));
  }

  /** @param {number} offset @param {Uint8Array} bytes */
  #keep(offset, bytes) {
    this.store.supply(offset, bytes);
    this.bytes += bytes.length;
    for (const wake of this.waiting.splice(0)) wake();
    this.onProgress();
  }

  /** Whether bytes of these ranges lack. @param {[number, number][]} ranges */
  lacks(ranges) { return ranges.some(([offset, size]) => !this.store.has(offset, size)); }

  /** How many bytes of these ranges lack. @param {[number, number][]} ranges */
  missingBytes(ranges) { return this.store.missing(ranges, 0, 2 ** 50).reduce((sum, [, size]) => sum + size, 0); }

  /**
   * Yields parts as their bytes arrive, which `fetching` brings.
   * @template {{ranges: [number, number][]}} Part @param {Part[]} parts @param {Promise<void>} fetching
   */
  async *arrivals(parts, fetching) {
    let ended = false;
    const end = fetching.then(() => { ended = true; });
    end.catch(() => {});  // next time, or by who waits for `fetching`
    for (let left = [...parts]; left.length > 0;) {
      const here = left.filter(part => ended || !this.lacks(part.ranges));
      if (here.length === 0) {
        await Promise.race([end, new Promise(resolve => this.waiting.push(() => resolve(undefined)))]);
        continue;
      }
      left = left.filter(part => !here.includes(part));
      yield *here;
    }
  }

  /**
   * @param {[number, number][]} ranges @param {AbortSignal} signal
   * @param {boolean} [urgent] requests that run at the same time cost less than bytes between them
   */
  async fetch(ranges, signal, urgent = false) {
    if (signal.aborted) throw abortError();
    this.store.use(ranges);
    const pieces = this.store.missing(ranges, this.mergeGap, this.source.isLocal ? 2 ** 30 : this.maxBytes,
                                      urgent ? parallel : 1);
    if (pieces.length === 0) return;
    let next = 0;
    const stop = new AbortController();
    const abort = () => stop.abort();
    signal.addEventListener('abort', abort, {once: true});
    const worker = async () => {
      while (next < pieces.length) {
        const [offset, size] = pieces[next++];
        const sent = now();
        let first = 0;
        await this.source.read(offset, size, stop.signal,
                               (/** @type {number} */ at, /** @type {Uint8Array} */ bytes) => {
                                 this.#keep(at, bytes);
                               }, () => { first = now(); });
        if (first > 0) this.onTransfer(sent, first, now(), size);
      }
    };
    try {
      await Promise.all(Array.from({length: Math.min(parallel, pieces.length)}, worker));
    } catch (error) {
      stop.abort();
      throw error;
    } finally {
      signal.removeEventListener('abort', abort);
    }
  }

  /**
   * Calls fn until no bytes lack.
   * @template T @param {() => T | undefined} fn @param {AbortSignal} signal @returns {Promise<T>}
   */
  async with(fn, signal) {
    for (;;) {
      if (signal.aborted) throw abortError();
      const result = fn();
      if (result !== undefined) return result;
      const ranges = this.store.missed();
      await this.fetch(ranges, signal);
    }
  }

  /**
   * Fetches what reads(step) names, step by step.
   * @param {(step: number) => [number, number][] | undefined} reads @param {number} last
   * @param {AbortSignal} signal
   */
  async steps(reads, last, signal) {
    for (let step = steps.pageTables; step <= last; ++step) {
      await this.fetch(await this.with(() => reads(step), signal), signal);
    }
  }
}
