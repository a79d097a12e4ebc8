// SPDX-License-Identifier: Apache-2.0
import * as THREE from 'three';

export const rowsPerLine = 256;

/** Rows of buckets in textures of three.js: each bucket has lines of its own, of 256 Gaussians. */
export class RowTextures {
  /** @param {number} maxRows @param {number} shTexels of a Gaussian */
  constructor(maxRows, shTexels) {
    this.shTexels = shTexels;
    this.maxLines = Math.min(Math.ceil(maxRows / rowsPerLine), 8192);
    /** @type {Map<string, {lines: number[], center: number, stream: number}>} */
    this.buckets = new Map();
    /** @type {number[]} the lowest last */
    this.free = [];
    this.lines = 0;
    this.#resize(16);
  }

  /** @param {string} key */
  remove(key) {
    const bucket = this.buckets.get(key);
    if (!bucket) return;
    this.buckets.delete(key);
    for (const line of bucket.lines) this.#close(line);
    this.free.push(...bucket.lines);
    this.free.sort((a, b) => b - a);
  }

  /** Takes a bucket in; false if it does not fit. @param {import('l4dcodec').BucketRows} rows */
  add(rows) {
    this.remove(rows.key);
    const count = Math.ceil(rows.count / rowsPerLine);
    while (count > this.free.length && this.lines < this.maxLines) this.#resize(2 * this.lines);
    if (count > this.free.length) return false;
    const lines = Array.from({length: count}, () => /** @type {number} */ (this.free.pop()));
    for (const [k, line] of lines.entries()) {
      this.#copy(this.rows, line, rows.geometry, 16 * rowsPerLine * k, 16);
      this.#copy(this.harmonics, line, rows.sh, rows.shStride * rowsPerLine * k, rows.shStride);
    }
    this.buckets.set(rows.key, {lines, center: rows.center, stream: rows.stream});
    return true;
  }

  /** Nothing is seen in frame -1. @param {number} line */
  #close(line) { this.instants.set([0, -1], 4 * line); }

  /** The instant of each stream that is shown; rows of others are not seen. @param {import('l4dcodec').StreamTime[]} streams */
  setTime(streams) {
    const shown = new Map(streams.map(s => [s.stream, s]));
    for (const {lines, center, stream} of this.buckets.values()) {
      const at = shown.get(stream);
      for (const line of lines) {
        if (at) this.instants.set([at.time - center, at.frame], 4 * line);
        else this.#close(line);
      }
    }
    this.times.needsUpdate = true;
  }

  dispose() {
    for (const texture of [this.rows, this.harmonics, this.times]) texture.dispose();
  }

  /** One line. @param {any} texture @param {number} line @param {Float32Array | Uint16Array} from @param {number} begin @param {number} stride */
  #copy(texture, line, from, begin, stride) {
    const width = stride * rowsPerLine;
    const to = texture.image.data;
    to.fill(0, width * line, width * (line + 1));
    to.set(from.subarray(begin, begin + width), width * line);
    // A texture that is new comes whole: with ranges, nothing but these would come.
    if (texture.userData.isThere) texture.addUpdateRange(width * line, width);
    texture.needsUpdate = true;
  }

  /** Larger textures, with what the smaller ones held. @param {number} wanted lines */
  #resize(wanted) {
    const lines = Math.min(wanted, this.maxLines);
    const make = (/** @type {any} */ old, /** @type {any} */ data, /** @type {number} */ width, /** @type {any} */ type) => {
      if (old) data.set(old.image.data);
      old?.dispose();
      // Nearest, no mipmaps: three's own defaults for data.
      const texture = new THREE.DataTexture(data, width, lines, THREE.RGBAFormat, type);
      texture.onUpdate = () => { texture.userData.isThere = true; };
      texture.needsUpdate = true;
      return texture;
    };
    this.rows = make(this.rows, new Float32Array(16 * rowsPerLine * lines), 4 * rowsPerLine, THREE.FloatType);
    this.harmonics = make(this.harmonics, new Uint16Array(4 * this.shTexels * rowsPerLine * lines),
                          this.shTexels * rowsPerLine, THREE.HalfFloatType);
    this.times = make(this.times, new Float32Array(4 * lines), 1, THREE.FloatType);
    /** @type {Float32Array} */
    this.instants = this.times.image.data;
    for (let line = lines - 1; line >= this.lines; --line) {
      this.#close(line);
      this.free.push(line);
    }
    this.free.sort((a, b) => b - a);
    this.lines = lines;
  }
}
