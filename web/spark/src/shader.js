// SPDX-License-Identifier: Apache-2.0
// Rows of Gaussians at an instant, as Spark wants them: the rules of the player, in functions for its shader graph.
import {directionRules, glsl, shRules, sliceRules, usualRendering} from 'l4dcodec-player/rules';
import {rowsPerLine} from './textures.js';

/** @param {string} rule */
const withTerms = rule => rule.replaceAll('term(', 'L4D_TERM(');

/** @param {number} degree of SH @param {number} texels of a Gaussian's SH */
export const sliceFunctions = (degree, texels) => `
vec3 l4dShade(sampler2D harmonics, ivec2 at, vec3 position, vec3 center) {
  vec3 forward = vec3(0.0, 0.0, 1.0);
  float c[${4 * texels}];
  for (int k = 0; k < ${texels}; ++k) {
    vec4 four = texelFetch(harmonics, ivec2(at.x + k, at.y), 0);
    c[4 * k] = four.x;
    c[4 * k + 1] = four.y;
    c[4 * k + 2] = four.z;
    c[4 * k + 3] = four.w;
  }
  #define L4D_TERM(k) vec3(c[3 * (k)], c[3 * (k) + 1], c[3 * (k) + 2])
  ${glsl(directionRules)}
  vec3 color = ${withTerms(shRules[0])};
${shRules.slice(1, degree + 1).map(rule => `  color += ${withTerms(rule)};`).join('\n')}
  return max(color, 0.0);
}

CovSplat l4dSlice(int row, sampler2D rows, sampler2D harmonics, sampler2D times, mat3 basis, vec3 offset, vec3 eye) {
  CovSplat splat;
  splat.flags = 0u;
  splat.index = row;
  splat.center = splat.xxyyzz = splat.xyxzyz = vec3(0.0);
  splat.rgba = vec4(0.0);
  ivec2 at = ivec2(row % ${rowsPerLine}, row / ${rowsPerLine});
  vec4 instant = texelFetch(times, ivec2(0, at.y), 0);
  if (instant.y < 0.0) return splat;  // of a stream that is not shown
  float time = instant.x;
  vec4 a = texelFetch(rows, ivec2(4 * at.x, at.y), 0);
  vec4 b = texelFetch(rows, ivec2(4 * at.x + 1, at.y), 0);
  vec4 c = texelFetch(rows, ivec2(4 * at.x + 2, at.y), 0);
  vec4 d = texelFetch(rows, ivec2(4 * at.x + 3, at.y), 0);
  float frame = instant.y;
  ${glsl(sliceRules(usualRendering).replaceAll('skip;', 'return splat;'))}
  mat3 sigma = basis * mat3(c.x, c.y, c.z, c.y, c.w, d.x, c.z, d.x, d.y) * transpose(basis);
  splat.flags = GSPLAT_FLAG_ACTIVE;
  splat.center = basis * position + offset;
  splat.rgba = vec4(l4dShade(harmonics, ivec2(${texels} * at.x, at.y), position, eye), opacity);
  splat.xxyyzz = vec3(sigma[0].x, sigma[1].y, sigma[2].z);
  splat.xyxzyz = vec3(sigma[0].y, sigma[0].z, sigma[1].z);
  return splat;
}`;
