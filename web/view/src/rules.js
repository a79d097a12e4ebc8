// SPDX-License-Identifier: Apache-2.0
// The rules of `l4dcodec render` (render/frame/project.h, render/view/view.h, render/sh.h), once for both shading languages.
// They are written in what GLSL and WGSL have in common. Three things differ, which `glsl` and `wgsl` put in the
// words of their language: declarations (`let name: type = ..`), names of types, and `skip`, which ends the work on
// a Gaussian that is not seen.

import {eyeOf} from './camera.js';

export const rowsPerLine = 256;

/** @typedef {import('l4dcodec').Rendering} Rendering numbers that a stream may state; shaders have them as constants */
/** The numbers of 3D Gaussian splatting. @type {Rendering} */
export const usualRendering = Object.freeze({dilation: 0.3, cutoff: 0, minAlpha: 1 / 255, maxAlpha: 0.999, compensation: false});

/** A number in both languages. @param {number} value */
const literal = value => {
  const text = String(value);
  return /[.e]/.test(text) ? text : `${text}.0`;
};

/** @param {string} rules */
export const glsl = rules => rules.replace(/\b(?:let|var) (\w+): (\w+) =/g, '$2 $1 =').replace(/\bskip;/g, 'return;');

/** @param {string} rules */
export const wgsl = rules => rules.replace(/\bfloat\b/g, 'f32').replace(/\bmat3\b/g, 'mat3x3f')
  .replace(/\bvec([234])\b/g, 'vec$1f').replace(/\bskip;/g, 'return false;');

/**
 * The opacity and the position of a Gaussian at an instant. In: the row (vec4 a, b, c, d), `time` in seconds from the
 * centre of its bucket, `frame` that the instant belongs to. Out: `opacity`, `position`.
 * @param {Rendering} rendering
 */
export const sliceRules = ({minAlpha}) => `
  var age: float = 0.0;
  if (d.w < 0.0) {  // a flat window
    if (frame < d.z || frame >= -d.w) { skip; }
  } else {
    let since: float = time - d.z;
    age = d.w * since * since;
    if (!(age <= 16.0)) { skip; }
  }
  var opacity: float = a.w * exp(-0.5 * age);
  if (!(opacity >= ${literal(minAlpha)})) { skip; }
  let position: vec3 = a.xyz + b.xyz * (time - b.w);
`;

/** @param {Rendering} rendering */
const compensationRules = ({minAlpha}) => `
  let bareDet: float = bareX * bareY - xy * xy;
  if (!(bareDet > 0.0)) { skip; }
  opacity = opacity * sqrt(bareDet / det);
  if (!(opacity >= ${literal(minAlpha)})) { skip; }
`;

/** Standard deviations at which a splat ends. @param {Rendering} rendering @param {string} opacity what it is in the shader */
export const radiusRule = ({minAlpha, cutoff}, opacity) => {
  const reach = `max(2.0 * log(${opacity} / ${literal(minAlpha)}), 0.0)`;
  return `sqrt(${cutoff > 0 ? `min(${reach}, ${literal(cutoff * cutoff)})` : reach})`;
};

/**
 * Its ellipse in the image. In: c, d, `opacity` and `position`; of the camera: `rotation` (world to camera),
 * `translation`, `focal`, `origin`, `size` (pixels), `nearPlane`, and `slopes`, the least and the greatest x/z and y/z of
 * the affine approximation. Out: `p` in camera axes, `mean`, `axis` (a unit vector), `large` and `small` (variances
 * along it and across), `radius` in standard deviations, beyond which nothing shows; `opacity` makes up for dilation where
 * it has to.
 * @param {Rendering} rendering
 */
export const projectRules = rendering => `
  let p: vec3 = rotation * position + translation;
  if (!(p.z > nearPlane)) { skip; }
  let slope: vec2 = clamp(p.xy / p.z, slopes.xy, slopes.zw);
  let right: vec3 = vec3(rotation[0].x, rotation[1].x, rotation[2].x);
  let down: vec3 = vec3(rotation[0].y, rotation[1].y, rotation[2].y);
  let forward: vec3 = vec3(rotation[0].z, rotation[1].z, rotation[2].z);
  let jx: vec3 = focal.x / p.z * (right - slope.x * forward);
  let jy: vec3 = focal.y / p.z * (down - slope.y * forward);
  let sigma: mat3 = mat3(c.x, c.y, c.z, c.y, c.w, d.x, c.z, d.x, d.y);
  let sx: vec3 = sigma * jx;
  let bareX: float = dot(sx, jx);
  let xy: float = dot(sx, jy);
  let bareY: float = dot(sigma * jy, jy);
  let xx: float = bareX + ${literal(rendering.dilation)};
  let yy: float = bareY + ${literal(rendering.dilation)};
  let det: float = xx * yy - xy * xy;
  if (!(det > 0.0)) { skip; }
${rendering.compensation ? compensationRules(rendering) : ''}
  let radius: float = ${radiusRule(rendering, 'opacity')};
  let mean: vec2 = focal * p.xy / p.z + origin;
  let extent: vec2 = radius * sqrt(vec2(xx, yy));
  if (mean.x + extent.x < 0.5 || mean.y + extent.y < 0.5) { skip; }
  if (mean.x - extent.x > size.x - 0.5 || mean.y - extent.y > size.y - 0.5) { skip; }

  let middle: float = 0.5 * (xx + yy);
  let large: float = middle + sqrt(max(0.25 * (xx - yy) * (xx - yy) + xy * xy, 0.0));
  let small: float = det / large;
  var axis: vec2 = vec2(large - yy, xy);
  if (xx < yy) { axis = vec2(xy, large - xx); }
  let length2: float = dot(axis, axis);
  if (length2 > 0.0) { axis = axis / sqrt(length2); } else { axis = vec2(1.0, 0.0); }
`;

/** From where it is seen. In: `position`, `center` of the camera, `forward`. Out: x, y, z and their squares. */
export const directionRules = `
  let toward: vec3 = position - center;
  let far: float = length(toward);
  var direction: vec3 = forward;
  if (far > 0.0) { direction = toward / far; }
  let x: float = direction.x;
  let y: float = direction.y;
  let z: float = direction.z;
  let x2: float = x * x;
  let y2: float = y * y;
  let z2: float = z * z;
`;

/** What each degree of SH adds to the colour; term(k) is the coefficients [3] of SH term k. */
export const shRules = [
  '0.5 + 0.28209479177387814 * term(0)',
  '0.4886025119029199 * (-y * term(1) + z * term(2) - x * term(3))',
  `1.0925484305920792 * (x * y * term(4) - y * z * term(5) - x * z * term(7)) +
    0.31539156525252005 * (2.0 * z2 - x2 - y2) * term(6) + 0.5462742152960396 * (x2 - y2) * term(8)`,
  `-0.5900435899266435 * (y * (3.0 * x2 - y2) * term(9) + x * (x2 - 3.0 * y2) * term(15)) +
    2.890611442640554 * x * y * z * term(10) -
    0.4570457994644658 * (4.0 * z2 - x2 - y2) * (y * term(11) + x * term(13)) +
    0.3731763325901154 * z * (2.0 * z2 - 3.0 * x2 - 3.0 * y2) * term(12) +
    1.445305721320277 * z * (x2 - y2) * term(14)`
];

/**
 * What a splat adds to a pixel. In: `place` in standard deviations, `opacity`. Out: `alpha`; below the limit: none.
 * @param {Rendering} rendering
 */
export const alphaRules = ({minAlpha, maxAlpha, cutoff}) => `
  let q: float = dot(place, place);
  let alpha: float = min(${literal(maxAlpha)}, opacity * exp(-0.5 * q));
  if (alpha < ${literal(minAlpha)}${cutoff > 0 ? ` || q > ${literal(cutoff * cutoff)}` : ''}) { discard; }
`;

export const frustumMargin = 0.3;  // of half the picture, as render/view/view.h has it

/**
 * What the rules need of a camera, in their names.
 * @param {import('./camera.js').Camera} camera @param {number} width pixels @param {number} height
 */
export const cameraTerms = ({worldToCamera: m, fx, fy, cx, cy, nearPlane, center, depths}, width, height) => {
  const margins = [frustumMargin * 0.5 * width / fx, frustumMargin * 0.5 * height / fy];
  return {
    rotation: [m[0], m[4], m[8], m[1], m[5], m[9], m[2], m[6], m[10]],  // by columns
    translation: [m[3], m[7], m[11]],
    center: center ?? eyeOf(m), focal: [fx, fy], origin: [cx, cy], size: [width, height],
    slopes: [-cx / fx - margins[0], -cy / fy - margins[1], (width - cx) / fx + margins[0], (height - cy) / fy + margins[1]],
    nearPlane, depths: depths ?? [0, 0]
  };
};
