// SPDX-License-Identifier: Apache-2.0

/** @typedef {WebGL2RenderingContext} GL */

const switches = /** @type {const} */ (['BLEND', 'CULL_FACE', 'DEPTH_TEST', 'POLYGON_OFFSET_FILL', 'RASTERIZER_DISCARD',
                                       'SAMPLE_ALPHA_TO_COVERAGE', 'SAMPLE_COVERAGE', 'STENCIL_TEST']);
const unpacking = /** @type {const} */ (['UNPACK_ALIGNMENT', 'UNPACK_FLIP_Y_WEBGL', 'UNPACK_PREMULTIPLY_ALPHA_WEBGL', 'UNPACK_ROW_LENGTH',
                                        'UNPACK_IMAGE_HEIGHT', 'UNPACK_SKIP_PIXELS', 'UNPACK_SKIP_ROWS', 'UNPACK_SKIP_IMAGES']);
const units = [0, 1, 2];  // that a painter uses

/** @typedef {[string[], (gl: GL, ...values: any[]) => void][]} Ways of setting a state, with what of it there is */
/** @type {Ways} */
const bindings = [
  [['CURRENT_PROGRAM'], (gl, program) => gl.useProgram(program)],
  [['VERTEX_ARRAY_BINDING'], (gl, array) => gl.bindVertexArray(array)],
  [['ARRAY_BUFFER_BINDING'], (gl, buffer) => gl.bindBuffer(gl.ARRAY_BUFFER, buffer)],
  [['PIXEL_UNPACK_BUFFER_BINDING'], (gl, buffer) => gl.bindBuffer(gl.PIXEL_UNPACK_BUFFER, buffer)],
  [['DRAW_FRAMEBUFFER_BINDING'], (gl, frame) => gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, frame)],
  [['READ_FRAMEBUFFER_BINDING'], (gl, frame) => gl.bindFramebuffer(gl.READ_FRAMEBUFFER, frame)],
  [['RENDERBUFFER_BINDING'], (gl, buffer) => gl.bindRenderbuffer(gl.RENDERBUFFER, buffer)]
];
/** Browsers know these of no context without waiting for the process that draws. @type {Ways} */
const settings = [
  [['BLEND_SRC_RGB', 'BLEND_DST_RGB', 'BLEND_SRC_ALPHA', 'BLEND_DST_ALPHA'], (gl, ...factors) => gl.blendFuncSeparate(.../** @type {[any, any, any, any]} */ (factors))],
  [['BLEND_EQUATION_RGB', 'BLEND_EQUATION_ALPHA'], (gl, color, alpha) => gl.blendEquationSeparate(color, alpha)],
  [['DEPTH_FUNC'], (gl, func) => gl.depthFunc(func)],
  [['DEPTH_WRITEMASK'], (gl, mask) => gl.depthMask(mask)],
  [['COLOR_WRITEMASK'], (gl, mask) => gl.colorMask(.../** @type {[any, any, any, any]} */ (mask))]
];

/**
 * Calls fn on a context that an engine has, too, which remembers what it set: all that a painter sets is as before
 * afterwards. For fn all is off and unpacking is as at first; framebuffers, viewport and scissor are the engine's.
 * @template T @param {GL} gl @param {() => T} fn
 * @param {boolean} [setsAll] blending, depth and masks, too: for fn they are what a transparent object needs @returns {T}
 */
export const keepState = (gl, fn, setsAll = false) => {
  if (gl.isContextLost()) return fn();
  const constant = /** @type {any} */ (gl);
  const get = (/** @type {string} */ name) => gl.getParameter(constant[name]);
  const states = setsAll ? [...bindings, ...settings] : bindings;
  const kept = states.map(([names]) => names.map(get));
  const isOn = switches.map(name => gl.isEnabled(gl[name]));
  const unpack = unpacking.map(get);
  const active = get('ACTIVE_TEXTURE');
  const bound = units.map(unit => {
    gl.activeTexture(gl.TEXTURE0 + unit);
    const pair = [get('TEXTURE_BINDING_2D'), get('SAMPLER_BINDING')];
    gl.bindSampler(unit, null);
    return pair;
  });
  for (const name of switches) gl.disable(gl[name]);
  for (const name of unpacking) gl.pixelStorei(gl[name], name === 'UNPACK_ALIGNMENT' ? 4 : 0);
  gl.bindBuffer(gl.PIXEL_UNPACK_BUFFER, null);
  gl.bindVertexArray(null);
  if (setsAll) {
    gl.blendEquation(gl.FUNC_ADD);
    gl.colorMask(true, true, true, true);
    gl.depthMask(false);
  }
  try {
    return fn();
  } finally {
    for (const unit of units) {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, bound[unit][0]);
      gl.bindSampler(unit, bound[unit][1]);
    }
    gl.activeTexture(active);
    for (const [k, name] of unpacking.entries()) gl.pixelStorei(gl[name], unpack[k]);
    for (const [k, name] of switches.entries()) (isOn[k] ? gl.enable : gl.disable).call(gl, gl[name]);
    for (const [k, [, set]] of states.entries()) set(gl, ...kept[k]);
  }
};
