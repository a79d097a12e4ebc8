// SPDX-License-Identifier: Apache-2.0
// Rows of Gaussians at an instant, as Spark wants them: the rules of specification section 16, and colours from SH.
import {rowsPerLine} from './textures.js';

/** @param {number} degree of SH @param {number} texels of a Gaussian's SH */
export const sliceFunctions = (degree, texels) => `
vec3 l4dShade(sampler2D harmonics, ivec2 at, vec3 d) {
  float c[${4 * texels}];
  for (int k = 0; k < ${texels}; ++k) {
    vec4 four = texelFetch(harmonics, ivec2(at.x + k, at.y), 0);
    c[4 * k] = four.x;
    c[4 * k + 1] = four.y;
    c[4 * k + 2] = four.z;
    c[4 * k + 3] = four.w;
  }
  #define L4D_TERM(k) vec3(c[3 * (k)], c[3 * (k) + 1], c[3 * (k) + 2])
  vec3 color = 0.5 + 0.28209479177387814 * L4D_TERM(0);
  float x = d.x, y = d.y, z = d.z, xx = x * x, yy = y * y, zz = z * z;
${degree < 1 ? '' : `
  color += 0.4886025119029199 * (-y * L4D_TERM(1) + z * L4D_TERM(2) - x * L4D_TERM(3));`}
${degree < 2 ? '' : `
  color += 1.0925484305920792 * (x * y * L4D_TERM(4) - y * z * L4D_TERM(5) - x * z * L4D_TERM(7)) +
    0.31539156525252005 * (2.0 * zz - xx - yy) * L4D_TERM(6) + 0.5462742152960396 * (xx - yy) * L4D_TERM(8);`}
${degree < 3 ? '' : `
  color += -0.5900435899266435 * (y * (3.0 * xx - yy) * L4D_TERM(9) + x * (xx - 3.0 * yy) * L4D_TERM(15)) +
    2.890611442640554 * x * y * z * L4D_TERM(10) -
    0.4570457994644658 * (4.0 * zz - xx - yy) * (y * L4D_TERM(11) + x * L4D_TERM(13)) +
    0.3731763325901154 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy) * L4D_TERM(12) +
    1.445305721320277 * z * (xx - yy) * L4D_TERM(14);`}
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
  float age = 0.0;
  if (d.w < 0.0) {
    if (instant.y < d.z || instant.y >= -d.w) return splat;
  } else {
    float since = time - d.z;
    age = d.w * since * since;
    if (!(age <= 16.0)) return splat;
  }
  float opacity = a.w * exp(-0.5 * age);
  if (!(opacity >= 1.0 / 255.0)) return splat;
  vec3 position = a.xyz + b.xyz * (time - b.w);
  mat3 sigma = basis * mat3(c.x, c.y, c.z, c.y, c.w, d.x, c.z, d.x, d.y) * transpose(basis);
  vec3 toward = position - eye;
  float far = length(toward);
  splat.flags = GSPLAT_FLAG_ACTIVE;
  splat.center = basis * position + offset;
  splat.rgba = vec4(l4dShade(harmonics, ivec2(${texels} * at.x, at.y), far > 0.0 ? toward / far : vec3(0.0, 0.0, 1.0)), opacity);
  splat.xxyyzz = vec3(sigma[0].x, sigma[1].y, sigma[2].z);
  splat.xyxzyz = vec3(sigma[0].y, sigma[0].z, sigma[1].z);
  return splat;
}`;
