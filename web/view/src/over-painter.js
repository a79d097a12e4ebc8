// SPDX-License-Identifier: Apache-2.0
import {Painter} from './painter.js';

/**
 * @typedef {object} Over how a picture is drawn over another one
 * @property {boolean} [isLinear] the framebuffer holds linear light (false)
 * @property {boolean} [isReversed] its depth is greater where it is nearer (false)
 */

/**
 * Draws over what an engine has drawn, where that is not nearer: into a target of its own, since a framebuffer of 8 bits
 * would round at each Gaussian, with a copy of the engine's depth. All calls are for keepState().
 */
export class OverPainter extends Painter {
  /** @param {WebGL2RenderingContext} gl @param {import('./painter.js').PainterOptions} options */
  constructor(gl, options) {
    super(gl, options);
    this.depth = gl.createRenderbuffer();
    this.depthKey = '';
    /** Of the depth of each framebuffer; null: it cannot be copied. @type {WeakMap<object, number | null>} */
    this.formats = new WeakMap();
  }

  /**
   * Draws into the viewport of the framebuffer that is bound.
   * @param {(width: number, height: number) => import('./camera.js').Camera} cameraOf
   * @param {import('l4dcodec').StreamTime[]} streams that are shown @param {Over} over
   */
  drawOver(cameraOf, streams, {isLinear = false, isReversed = false}) {
    if (this.count === 0) return;
    const gl = this.gl;
    /** @type {WebGLFramebuffer | null} */
    const below = gl.getParameter(gl.DRAW_FRAMEBUFFER_BINDING);
    const [x, y, width, height] = gl.getParameter(gl.VIEWPORT);
    const hasOwn = this.isFloat && this.#copyDepth(below, x, y, width, height);
    if (hasOwn) {
      gl.clearBufferfv(gl.COLOR, 0, [0, 0, 0, 0]);
    } else {
      gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, below);
    }
    this.store.setTime(streams);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(isReversed ? gl.GEQUAL : gl.LEQUAL);
    this.splats(cameraOf(width, height), width, height);
    if (!hasOwn) return;
    gl.disable(gl.DEPTH_TEST);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, below);
    this.copyPicture(isLinear);
  }

  /**
   * Binds the own target, with the depth of another framebuffer; false: that cannot be.
   * @param {WebGLFramebuffer | null} below @param {number} x @param {number} y @param {number} width @param {number} height
   */
  #copyDepth(below, x, y, width, height) {
    const gl = this.gl;
    const known = this.formats.get(below ?? gl);
    if (known === null) return false;
    const formats = known === undefined ? this.#formatsOf(below) : [known];
    this.resize(Math.max(this.size[0], x + width), Math.max(this.size[1], y + height));
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, below);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, this.frame);
    for (const format of formats) {
      this.#setDepth(format);
      // Errors of before are others'.
      if (known === undefined) while (gl.getError() !== gl.NO_ERROR && !gl.isContextLost());
      // Of a framebuffer with samples, both places must be the same.
      if (format !== gl.NONE) gl.blitFramebuffer(x, y, x + width, y + height, x, y, x + width, y + height, gl.DEPTH_BUFFER_BIT, gl.NEAREST);
      if (known !== undefined || gl.getError() === gl.NO_ERROR) {
        this.formats.set(below ?? gl, format);
        return true;
      }
    }
    this.formats.set(below ?? gl, null);
    return false;
  }

  /** Those that the depth of a framebuffer may have, the likeliest first; NONE: it has no depth. @param {WebGLFramebuffer | null} below */
  #formatsOf(below) {
    const gl = this.gl;
    const get = (/** @type {number} */ attachment, /** @type {number} */ name) => gl.getFramebufferAttachmentParameter(gl.DRAW_FRAMEBUFFER, attachment, name);
    const [depth, stencil] = below ? [gl.DEPTH_ATTACHMENT, gl.STENCIL_ATTACHMENT] : [gl.DEPTH, gl.STENCIL];
    const isThere = (/** @type {number} */ attachment) => get(attachment, gl.FRAMEBUFFER_ATTACHMENT_OBJECT_TYPE) !== gl.NONE;
    if (!isThere(depth)) return [gl.NONE];
    const bits = get(depth, gl.FRAMEBUFFER_ATTACHMENT_DEPTH_SIZE);
    const pair = bits === 32 ? [gl.DEPTH_COMPONENT32F, gl.DEPTH32F_STENCIL8] :
      [bits === 16 ? gl.DEPTH_COMPONENT16 : gl.DEPTH_COMPONENT24, gl.DEPTH24_STENCIL8];
    return isThere(stencil) ? pair.reverse() : pair;
  }

  /** @param {number} format */
  #setDepth(format) {
    const gl = this.gl;
    const [width, height] = this.size;
    const key = `${format} ${width} ${height}`;
    if (this.depthKey === key) return;
    this.depthKey = key;
    gl.bindRenderbuffer(gl.RENDERBUFFER, this.depth);
    if (format !== gl.NONE) gl.renderbufferStorage(gl.RENDERBUFFER, format, width, height);
    gl.framebufferRenderbuffer(gl.DRAW_FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, format === gl.NONE ? null : this.depth);
  }

  dispose() {
    super.dispose();
    this.gl.deleteRenderbuffer(this.depth);
  }
}
