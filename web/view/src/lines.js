// SPDX-License-Identifier: Apache-2.0
import {rowsPerLine} from './rules.js';

/** Which lines of 256 Gaussians belong to which bucket, whatever holds them. */
export class RowLines {
  /** @param {number} lines */
  constructor(lines) {
    this.lines = lines;
    /** @type {Map<string, {lines: Uint32Array, center: number, count: number, stream: number}>} */
    this.buckets = new Map();
    /** @type {number[]} the lowest last */
    this.free = Array.from({length: lines}, (_, k) => lines - 1 - k);
  }

  /** @param {string} key */
  remove(key) {
    const bucket = this.buckets.get(key);
    if (!bucket) return;
    this.buckets.delete(key);
    this.free.push(...bucket.lines);
    this.free.sort((a, b) => b - a);
  }

  /** Takes lines for a bucket; null where there are too few. @param {import('l4dcodec').BucketRows} rows */
  take({key, count, center, stream}) {
    this.remove(key);
    const needed = Math.ceil(count / rowsPerLine);
    if (needed > this.free.length) return null;
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
