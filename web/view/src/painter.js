// SPDX-License-Identifier: Apache-2.0
import {cameraTerms, usualRendering} from './rules.js';
import {copyFragment, copyVertex, splatFragment, splatVertex} from './shaders.js';
import {RowTextures} from './store.js';

/** @param {WebGL2RenderingContext} gl @param {string} vertex @param {string} fragment */
const link = (gl, vertex, fragment) => {
  const program = gl.createProgram();
  for (const [type, source] of /** @type {[number, string][]} */ ([[gl.VERTEX_SHADER, vertex],
                                                                   [gl.FRAGMENT_SHADER, fragment]])) {
    const shader = /** @type {WebGLShader} */ (gl.createShader(type));
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
    const logs = (gl.getAttachedShaders(program) ?? []).map(s => gl.getShaderInfoLog(s));
    throw new Error(`shaders: ${gl.getProgramInfoLog(program)} ${logs.join(' ')}`);
  }
  return program;
};

/**
 * @typedef {object} PainterOptions
 * @property {number} maxRows @property {number} shDegree @property {'auto' | '10' | '16f'} [target]
 * @property {import('l4dcodec').Rendering} [rendering]
 */

/** What draws on a WebGL2 context; made anew where the context was lost. */
export class Painter {
  /** @param {WebGL2RenderingContext} gl @param {PainterOptions} options */
  constructor(gl, {maxRows, shDegree, target, rendering = usualRendering}) {
    this.gl = gl;
    this.sorts = false;  // a worker does
    this.degree = shDegree;
    this.maxRows = maxRows;
    const texels = Math.ceil(3 * (shDegree + 1) ** 2 / 4);
    this.store = new RowTextures(gl, maxRows, texels);
    this.program = link(gl, splatVertex(rendering), splatFragment(rendering));
    /** @type {Record<string, WebGLUniformLocation | null>} */
    this.at = {};
    for (const name of ['rows', 'harmonics', 'times', 'rotation', 'translation', 'center', 'focal', 'origin', 'size',
                        'slopes', 'nearPlane', 'depths', 'degree', 'texels', 'white']) {
      this.at[name] = gl.getUniformLocation(this.program, name);
    }
    // The canvas itself clamps what shines through to 1 at each Gaussian, and rounds it to 8 bits: 41 dB in
    // a trained scene. Where floats cannot be drawn to, 10 bits always can, with room above white.
    this.isFloat = target !== '10' && ['EXT_color_buffer_float', 'EXT_color_buffer_half_float']
      .some(name => gl.getExtension(name) !== null);
    this.white = this.isFloat ? 1 : 1 / 2;
    this.copy = link(gl, copyVertex, copyFragment);
    this.picture = gl.createTexture();
    this.frame = gl.createFramebuffer();
    this.size = [0, 0];
    this.array = gl.createVertexArray();
    this.order = gl.createBuffer();
    this.orderBytes = 0;
    this.count = 0;
    gl.bindVertexArray(this.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.order);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribIPointer(0, 1, gl.UNSIGNED_INT, 0, 0);
    gl.vertexAttribDivisor(0, 1);
    gl.bindVertexArray(null);
  }

  /** @param {Uint32Array} order @param {number} count */
  setOrder(order, count) {
    const gl = this.gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.order);
    if (4 * count > this.orderBytes) {
      this.orderBytes = 4 * Math.ceil(count * 1.25);
      gl.bufferData(gl.ARRAY_BUFFER, this.orderBytes, gl.STREAM_DRAW);
    }
    // A length of 0 would mean all of it.
    if (count > 0) gl.bufferSubData(gl.ARRAY_BUFFER, 0, order, 0, count);
    this.count = count;
  }

  /** @param {number} width @param {number} height */
  resize(width, height) {
    if (this.size[0] === width && this.size[1] === height) return;
    const gl = this.gl;
    this.size = [width, height];
    gl.bindTexture(gl.TEXTURE_2D, this.picture);
    const [format, type] = this.isFloat ? [gl.RGBA16F, gl.HALF_FLOAT] : [gl.RGB10_A2, gl.UNSIGNED_INT_2_10_10_10_REV];
    gl.texImage2D(gl.TEXTURE_2D, 0, format, width, height, 0, gl.RGBA, type, null);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.picture, 0);
  }

  /**
   * @param {import('./camera.js').Camera} camera @param {import('l4dcodec').StreamTime[]} streams that are shown
   * @param {number} width @param {number} height @param {[number, number, number]} background
   */
  draw(camera, streams, width, height, background) {
    const gl = this.gl;
    this.resize(width, height);
    this.store.setTime(streams);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
    gl.viewport(0, 0, width, height);
    const [red, green, blue] = background.map(c => c * this.white);
    gl.clearColor(red, green, blue, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
    if (this.count > 0) this.splats(camera, width, height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.disable(gl.BLEND);
    this.copyPicture(false);
  }

  /** From the target of blending to the framebuffer that is bound. @param {boolean} isLinear what is there is linear light */
  copyPicture(isLinear) {
    const gl = this.gl;
    const at = (/** @type {string} */ name) => gl.getUniformLocation(/** @type {WebGLProgram} */ (this.copy), name);
    gl.useProgram(this.copy);
    gl.uniform1f(at('white'), this.white);
    gl.uniform1i(at('isLinear'), Number(isLinear));
    this.#bind(0, this.picture);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  /** @param {number} unit @param {WebGLTexture | null} texture */
  #bind(unit, texture) {
    this.gl.activeTexture(this.gl.TEXTURE0 + unit);
    this.gl.bindTexture(this.gl.TEXTURE_2D, texture);
  }

  /** @param {import('./camera.js').Camera} camera @param {number} width @param {number} height */
  splats(camera, width, height) {
    const gl = this.gl;
    const at = this.at;
    const terms = cameraTerms(camera, width, height);
    gl.useProgram(this.program);
    this.#bind(1, this.store.harmonics);
    this.#bind(2, this.store.times);
    this.#bind(0, this.store.rows);
    gl.uniform1i(at.rows, 0);
    gl.uniform1i(at.harmonics, 1);
    gl.uniform1i(at.times, 2);
    gl.uniformMatrix3fv(at.rotation, false, terms.rotation);
    gl.uniform3fv(at.translation, terms.translation);
    gl.uniform3fv(at.center, terms.center);
    gl.uniform2fv(at.focal, terms.focal);
    gl.uniform2fv(at.origin, terms.origin);
    gl.uniform2fv(at.size, terms.size);
    gl.uniform4fv(at.slopes, terms.slopes);
    gl.uniform1f(at.nearPlane, terms.nearPlane);
    gl.uniform2fv(at.depths, terms.depths);
    gl.uniform1i(at.degree, this.degree);
    gl.uniform1f(at.white, this.white);
    gl.uniform1i(at.texels, this.store.shTexels);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.bindVertexArray(this.array);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, this.count);
    gl.bindVertexArray(null);
  }

  /** What was drawn in this task: [height, width, 4], from the top. @returns {Promise<Uint8Array>} */
  async pixels() {
    const gl = this.gl;
    const [width, height] = this.size;
    const rows = new Uint8Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, rows);
    const out = new Uint8Array(rows.length);
    for (let y = 0; y < height; ++y) {
      out.set(rows.subarray(4 * width * y, 4 * width * (y + 1)), 4 * width * (height - 1 - y));
    }
    return out;
  }

  /** Resolves when the GPU has drawn everything. */
  async finished() {
    const gl = this.gl;
    const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    if (!fence) return;
    gl.flush();
    while (gl.clientWaitSync(fence, 0, 0) === gl.TIMEOUT_EXPIRED) await new Promise(resolve => setTimeout(resolve, 1));
    gl.deleteSync(fence);
  }

  dispose() {
    this.store.dispose();
    const gl = this.gl;
    gl.deleteBuffer(this.order);
    gl.deleteVertexArray(this.array);
    gl.deleteTexture(this.picture);
    gl.deleteFramebuffer(this.frame);
    gl.deleteProgram(this.program);
    gl.deleteProgram(this.copy);
  }
}
