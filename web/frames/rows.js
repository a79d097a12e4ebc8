// SPDX-License-Identifier: Apache-2.0

export const degree = 3;
export const bucketRows = 65536;
const time = 1;
/** When all of them are seen. */
export const streams = [{stream: 0, time, frame: 0}];

/** Numbers from 0 to 1, the same each time. */
const randomNumbers = () => {
  let state = 1;
  return () => {
    state = Math.imul(state ^ state >>> 15, 0x2c1b3c6d) + 0x9e3779b9 | 0;
    return ((state ^ state >>> 13) >>> 0) / 2 ** 32;
  };
};

/**
 * Rows of moving Gaussians in a ball of radius 1, all of them seen then. They are the smaller the more there are, so
 * that a pixel is covered as often.
 * @param {number} count
 */
export const makeRows = count => {
  const random = randomNumbers();
  const size = 0.6 / Math.cbrt(count);
  const stride = 3 * (degree + 1) ** 2;
  const buckets = [];
  for (let begin = 0; begin < count; begin += bucketRows) {
    const n = Math.min(bucketRows, count - begin);
    const geometry = new Float32Array(16 * n);
    const sh = new Uint16Array(stride * n);
    for (let k = 0; k < n; ++k) {
      const at = [2, 2, 2];
      while (Math.hypot(...at) > 1) for (let i = 0; i < 3; ++i) at[i] = 2 * random() - 1;
      const scales = [0, 1, 2].map(() => (size * (0.3 + 1.4 * random())) ** 2);
      geometry.set([...at, 0.1 + 0.9 * random(), 0.01 * random(), 0.01 * random(), 0, time,
                    scales[0], 0, 0, scales[1], 0, scales[2], random(), 0.2 * random()], 16 * k);
      // Binary16 of -0.5 to 0.5, or of less in the detail.
      for (let i = 0; i < stride; ++i) sh[stride * k + i] = random() * (i < 3 ? 0x3800 : 0x2c00) | (random() < 0.5 ? 0x8000 : 0);
    }
    buckets.push({key: String(begin), stream: 0, count: n, center: 0, shStride: stride, geometry, sh, detail: 0, bucket: null});
  }
  return buckets;
};

/** @param {number[]} values */
export const median = values => [...values].sort((a, b) => a - b)[values.length >> 1];
