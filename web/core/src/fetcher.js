// SPDX-License-Identifier: Apache-2.0
import {abortError} from './errors.js';
import {steps} from './decoder.js';

const parallel = 4;          // requests in flight
const pieceBytes = 512 * 1024;

/** Brings bytes from a source to a store, and runs what needs them. */
export class Fetcher {
  /**
   * @param {any} source sources.js @param {import('./store.js').ByteStore} store
   * @param {() => void} [onProgress]
   */
  constructor(source, store, onProgress = () => {}) {
    this.source = source;
    this.store = store;
    this.onProgress = onProgress;
    this.bytes = 0;         // that have come
    /** @type {{bytes: number, seconds: number}[]} */
    this.recent = [];
  }

  /** Opens the source. @param {AbortSignal} signal */
  async open(signal) {
    this.store.size = await this.source.open(signal);
    this.source.begin?.((/** @type {number} */ offset, /** @type {Uint8Array} */ bytes) =>
      this.#keep(offset, bytes));
  }

  /** Bits a second of late, 0 where nothing is known. */
  get throughput() {
    const sum = this.recent.reduce((t, r) => t + r.seconds / Math.max(r.bytes, 1), 0);
    return sum > 0 ? 8 * this.recent.length / sum : 0;
  }

  /** @param {number} offset @param {Uint8Array} bytes */
  #keep(offset, bytes) {
    this.store.supply(offset, bytes);
    this.bytes += bytes.length;
    this.onProgress();
  }

  /** @param {[number, number][]} ranges @param {AbortSignal} signal */
  async fetch(ranges, signal) {
    if (signal.aborted) throw abortError();
    const pieces = this.store.missing(ranges, 16384, this.source.isLocal ? 2 ** 30 : pieceBytes);
    if (pieces.length === 0) return;
    const began = performance.now();
    const before = this.bytes;
    let next = 0;
    const stop = new AbortController();
    const abort = () => stop.abort();
    signal.addEventListener('abort', abort, {once: true});
    const worker = async () => {
      while (next < pieces.length) {
        const [offset, size] = pieces[next++];
        await this.source.read(offset, size, stop.signal,
                               (/** @type {number} */ at, /** @type {Uint8Array} */ bytes) => {
                                 this.#keep(at, bytes);
                               });
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
    this.recent.push({bytes: this.bytes - before, seconds: (performance.now() - began) / 1000});
    if (this.recent.length > 5) this.recent.shift();
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
