// SPDX-License-Identifier: Apache-2.0
import {rowsPerLine} from './rules.js';

/** @typedef {{lines: Uint32Array, center: number, count: number, stream: number}} Placed rows of a bucket */

/**
 * Which lines of 256 Gaussians belong to which bucket, whatever holds them. An order names rows by where they lie. So that
 * pictures can be drawn with it until there is a newer one, buckets that go keep their lines until release(), or until
 * there is no other room.
 */
export class RowLines {
  /** @param {number} lines @param {boolean} keeps lines of buckets that go */
  constructor(lines, keeps) {
    this.lines = lines;
    this.keeps = keeps;
    /** @type {Map<string, Placed>} */
    this.buckets = new Map();
    /** @type {number[]} the lowest last */
    this.free = Array.from({length: lines}, (_, k) => lines - 1 - k);
    /** How many buckets have gone. */
    this.gone = 0;
    /** Those that keep their lines, the oldest first; `gone` counts it, too. @type {(Placed & {gone: number})[]} */
    this.leaving = [];
    /** The first lines of those that had to give theirs up early. @type {{line: number, gone: number}[]} */
    this.lost = [];
  }

  /** @param {string} key */
  remove(key) {
    const bucket = this.buckets.get(key);
    if (!bucket) return;
    this.buckets.delete(key);
    ++this.gone;
    if (this.keeps) this.leaving.push({...bucket, gone: this.gone});
    else this.#free(bucket.lines);
  }

  /** @param {Uint32Array} lines */
  #free(lines) {
    this.free.push(...lines);
    this.free.sort((a, b) => b - a);
  }

  /** No order is older than the one of when so many buckets had gone. @param {number} gone */
  release(gone) {
    while (this.leaving.length > 0 && this.leaving[0].gone <= gone) this.#free(/** @type {Placed} */ (this.leaving.shift()).lines);
    this.lost = this.lost.filter(bucket => bucket.gone > gone);
  }

  /**
   * Whether all rows of an order still lie where they did.
   * @param {number} gone buckets, when it was asked for @param {Set<number>} firstLines of its buckets
   */
  isWhole(gone, firstLines) { return !this.lost.some(bucket => bucket.gone > gone && firstLines.has(bucket.line)); }

  /** Takes lines for a bucket; null where there are too few. @param {import('l4dcodec').BucketRows} rows */
  take({key, count, center, stream}) {
    this.remove(key);
    const needed = Math.ceil(count / rowsPerLine);
    while (needed > this.free.length) {
      const bucket = this.leaving.shift();
      if (!bucket) return null;
      this.#free(bucket.lines);
      this.lost.push({line: bucket.lines[0], gone: bucket.gone});
    }
    const lines = new Uint32Array(needed);
    for (let k = 0; k < needed; ++k) lines[k] = /** @type {number} */ (this.free.pop());
    this.buckets.set(key, {lines, center, count, stream});
    return lines;
  }

  /** Calls fn with the place of the first line and [begin, end) of each run of neighbours. @param {Uint32Array} lines
   *  @param {(line: number, begin: number, end: number) => void} fn */
  runs(lines, fn) {
    for (let k = 0; k < lines.length;) {
      let end = k + 1;
      while (end < lines.length && lines[end] === lines[end - 1] + 1) ++end;
      fn(lines[k], k, end);
      k = end;
    }
  }
}
