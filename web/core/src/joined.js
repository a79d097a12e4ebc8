// SPDX-License-Identifier: Apache-2.0
// Gaussians of several streams as one set.

/** @param {number} degree */
const termsOf = degree => 3 * (degree + 1) ** 2;

/**
 * Coefficients of another degree: those that lack are 0.
 * @template {Float32Array | Uint16Array} T @param {T} from @param {number} stride numbers of a row
 * @param {number} count rows @param {number} to numbers of a row then @returns {T}
 */
const widened = (from, stride, count, to) => {
  if (stride === to) return from;
  const out = /** @type {T} */ (new /** @type {any} */ (from.constructor)(to * count));
  const kept = Math.min(stride, to);
  for (let k = 0; k < count; ++k) out.set(from.subarray(stride * k, stride * k + kept), to * k);
  return out;
};

/**
 * SH of rows with as many terms as others have.
 * @param {{count: number, sh: Uint16Array, shStride: number}} rows @param {number} degree
 */
export const widenHarmonics = ({count, sh, shStride}, degree) => {
  const stride = Math.ceil(termsOf(degree) / 4) * 4;
  return {sh: widened(sh, shStride, count, stride), shStride: stride};
};

/** @param {import('./movie.js').Slice[]} slices @returns {import('./movie.js').Slice} */
export const joinSlices = slices => {
  if (slices.length === 1) return slices[0];
  const shDegree = Math.max(0, ...slices.map(s => s.shDegree));
  const join = (/** @type {Float32Array[]} */ arrays) => {
    const out = new Float32Array(arrays.reduce((sum, a) => sum + a.length, 0));
    let at = 0;
    for (const array of arrays) {
      out.set(array, at);
      at += array.length;
    }
    return out;
  };
  const withSh = slices.every(s => s.sh !== null);
  return {
    count: slices.reduce((sum, s) => sum + s.count, 0), shDegree,
    position: join(slices.map(s => s.position)), covariance: join(slices.map(s => s.covariance)),
    opacity: join(slices.map(s => s.opacity)),
    sh: withSh ? join(slices.map(s => widened(/** @type {Float32Array} */ (s.sh), termsOf(s.shDegree), s.count, termsOf(shDegree)))) : null
  };
};
