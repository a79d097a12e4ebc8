// SPDX-License-Identifier: Apache-2.0
// The order in which Gaussians are drawn at an instant: farthest first.

const packed = 11;  // position, opacity, velocity, reference time, mean time and lambda or a flat window, size
const digitBits = 11;
const digits = 1 << digitBits;
const leastAlpha = 1 / 255;  // of what bounds and points are of
const leastHit = 0.1;        // of light that is stopped, where there is something at all

/**
 * @typedef {object} Sight what the order depends on
 * @property {import('l4dcodec').StreamTime[]} streams that are shown
 * @property {[number, number, number, number]} depth z of the camera from x, y, z, 1
 * @property {number} nearPlane @property {number} minAlpha opacity below which nothing is seen
 */

export class Sorter {
  constructor() {
    /** @type {Map<string, {lines: Uint32Array, data: Float32Array, count: number, center: number, stream: number}>} */
    this.buckets = new Map();
    this.rows = 0;
    this.capacity = 0;
    this.histogram = [new Uint32Array(digits), new Uint32Array(digits)];
    this.depths = new Float32Array(0);
    this.bits = new Uint32Array(0);
    this.ids = [new Uint32Array(0), new Uint32Array(0)];
    this.keys = [new Uint32Array(0), new Uint32Array(0)];
  }

  /**
   * @param {string} key @param {Float32Array} geometry [count, 16], as rows have it
   * @param {Uint32Array} lines where each 256 of them lie @param {number} center @param {number} stream
   */
  add(key, geometry, lines, center, stream) {
    this.remove(key);
    const count = geometry.length / 16;
    const data = new Float32Array(packed * count);
    for (let k = 0; k < count; ++k) {
      const from = 16 * k;
      const to = packed * k;
      for (let i = 0; i < 8; ++i) data[to + i] = geometry[from + i];
      data[to + 8] = geometry[from + 14];
      data[to + 9] = geometry[from + 15];
      // The standard deviation of a disc that is as large.
      data[to + 10] = Math.sqrt((geometry[from + 8] + geometry[from + 11] + geometry[from + 13]) / 2);
    }
    this.buckets.set(key, {lines, data, count, center, stream});
    this.rows += count;
  }

  /** @param {string} key */
  remove(key) {
    this.rows -= this.buckets.get(key)?.count ?? 0;
    this.buckets.delete(key);
  }

  clear() {
    this.buckets.clear();
    this.rows = 0;
  }

  /** @param {number} rows */
  #reserve(rows) {
    if (rows <= this.capacity) return;
    this.capacity = Math.ceil(rows * 1.25);
    this.depths = new Float32Array(this.capacity);
    this.bits = new Uint32Array(this.depths.buffer);
    this.ids = [new Uint32Array(this.capacity), new Uint32Array(this.capacity)];
    this.keys = [new Uint32Array(this.capacity), new Uint32Array(this.capacity)];
  }

  /** Fills depths and ids[0]; returns how many are visible. @param {Sight} sight */
  #gather({streams, depth: [x, y, z, w], nearPlane, minAlpha}) {
    const depths = this.depths;
    const ids = this.ids[0];
    let visible = 0;
    this.firstLines = [];
    for (const {lines, data, count, center, stream} of this.buckets.values()) {
      const instant = streams.find(s => s.stream === stream);
      if (!instant) continue;
      const {frame} = instant;
      const t = Math.fround(instant.time - center);
      const before = visible;
      for (let k = 0; k < count; ++k) {
        const at = packed * k;
        if (data[at + 9] < 0) {
          if (frame < data[at + 8] || frame >= -data[at + 9]) continue;
        } else {
          const since = t - data[at + 8];
          const age = data[at + 9] * since * since;
          if (age > 16 || data[at + 3] * Math.exp(-0.5 * age) < minAlpha) continue;
        }
        const dt = t - data[at + 7];
        const d = x * (data[at] + data[at + 4] * dt) + y * (data[at + 1] + data[at + 5] * dt) +
          z * (data[at + 2] + data[at + 6] * dt) + w;
        if (!(d > nearPlane)) continue;
        depths[visible] = d;
        ids[visible++] = lines[k >> 8] * 256 + (k & 255);
      }
      if (visible > before) this.firstLines.push(lines[0]);
    }
    return visible;
  }

  /**
   * The places of the visible Gaussians, farthest first.
   * @param {Sight} sight @param {Uint32Array | null} [reuse] @returns {Uint32Array}
   */
  sort(sight, reuse = null) {
    this.#reserve(this.rows);
    const n = this.#gather(sight);
    const [bits, ids] = [this.bits, this.ids];
    // Bits of positive floats are in their order.
    let least = 0xffffffff, most = 0;
    for (let k = 0; k < n; ++k) {
      const b = bits[k];
      if (b < least) least = b;
      if (b > most) most = b;
    }
    let shift = 0;
    while ((most - least) >>> shift >= 1 << 2 * digitBits) ++shift;
    const [low, high] = this.histogram;
    low.fill(0);
    high.fill(0);
    const [keys, sortedKeys] = this.keys;
    for (let k = 0; k < n; ++k) {
      const key = (most - bits[k]) >>> shift;
      keys[k] = key;
      ++low[key & digits - 1];
      ++high[key >>> digitBits];
    }
    for (const histogram of this.histogram) {
      let sum = 0;
      for (let k = 0; k < digits; ++k) {
        const count = histogram[k];
        histogram[k] = sum;
        sum += count;
      }
    }
    for (let k = 0; k < n; ++k) {
      const to = low[keys[k] & digits - 1]++;
      sortedKeys[to] = keys[k];
      ids[1][to] = ids[0][k];
    }
    const order = reuse && reuse.length >= n ? reuse : new Uint32Array(Math.ceil(n * 1.1) + 1024);
    for (let k = 0; k < n; ++k) order[high[sortedKeys[k] >>> digitBits]++] = ids[1][k];
    this.visible = n;
    return order;
  }
  visible = 0;
  /** Of each bucket that has visible Gaussians. @type {number[]} */
  firstLines = [];

  /**
   * Calls fn with the position, the opacity and the size of each Gaussian that is seen at an instant.
   * @param {import('l4dcodec').StreamTime[]} streams @param {number} step of them, one is looked at
   * @param {(x: number, y: number, z: number, opacity: number, size: number) => void} fn
   */
  #each(streams, step, fn) {
    for (const {data, count, center, stream} of this.buckets.values()) {
      const instant = streams.find(s => s.stream === stream);
      if (!instant) continue;
      const {frame} = instant;
      const t = instant.time - center;
      for (let k = 0; k < count; k += step) {
        const at = packed * k;
        const since = t - data[at + 8];
        const flat = data[at + 9] < 0;
        const opacity = data[at + 3] * (flat ? 1 : Math.exp(-0.5 * data[at + 9] * since * since));
        if (opacity < leastAlpha || flat && (frame < data[at + 8] || frame >= -data[at + 9])) continue;
        const dt = t - data[at + 7];
        fn(data[at] + data[at + 4] * dt, data[at + 1] + data[at + 5] * dt, data[at + 2] + data[at + 6] * dt, opacity, data[at + 10]);
      }
    }
  }

  /**
   * The point where a ray has lost half of its light, or else where it loses most; null where it meets next to nothing. Gaussians
   * count as balls, which is near enough to point at something.
   * @param {Sight} sight @param {import('./camera.js').Ray} ray @returns {import('./camera.js').Vec3 | null}
   */
  pick({streams, depth: [x, y, z, w], nearPlane}, {origin, direction, blur}) {
    /** @type {[number, number][]} depth and alpha */
    const hits = [];
    this.#each(streams, 1, (px, py, pz, opacity, size) => {
      const far = x * px + y * py + z * pz + w;
      if (!(far > nearPlane)) return;
      const aside = (px - origin[0] - far * direction[0]) ** 2 + (py - origin[1] - far * direction[1]) ** 2 +
        (pz - origin[2] - far * direction[2]) ** 2;
      const alpha = opacity * Math.exp(-0.5 * aside / (size * size + (blur * far) ** 2));
      if (alpha >= leastAlpha) hits.push([far, Math.min(alpha, 1)]);
    });
    hits.sort((a, b) => a[0] - b[0]);
    let light = 1, at = 0, most = 0;
    for (const [far, alpha] of hits) {
      const stopped = light * alpha;
      light -= stopped;
      if (stopped > most || light < 0.5) [most, at] = [stopped, far];
      if (light < 0.5) break;
    }
    return 1 - light < leastHit ? null :
      [origin[0] + at * direction[0], origin[1] + at * direction[1], origin[2] + at * direction[2]];
  }

  /**
   * What a camera should look at: the median of the positions at an instant, weighted by opacity, and the
   * radius of the ball that holds nine tenths of the opacity.
   * @param {import('l4dcodec').StreamTime[]} streams
   */
  bounds(streams) {
    /** @type {number[][]} */
    const points = [];
    this.#each(streams, Math.max(1, Math.floor(this.rows / 50000)), (x, y, z, opacity) => points.push([x, y, z, opacity]));
    if (points.length === 0) return null;
    const total = points.reduce((sum, p) => sum + p[3], 0);
    const quantile = (/** @type {number[][]} */ pairs, /** @type {number} */ share) => {
      pairs.sort((a, b) => a[0] - b[0]);
      let sum = 0;
      for (const [value, weight] of pairs) if ((sum += weight) >= share * total) return value;
      return pairs[pairs.length - 1][0];
    };
    const along = (/** @type {number} */ i) => points.map(p => [p[i], p[3]]);
    const middle = [0, 1, 2].map(i => quantile(along(i), 0.5));
    const radius = quantile(points.map(p => [Math.hypot(...middle.map((m, i) => p[i] - m)), p[3]]), 0.9);
    return {middle, radius};
  }
}
