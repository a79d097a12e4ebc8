// SPDX-License-Identifier: Apache-2.0
import {L4DError} from 'l4dcodec';
import {Painter} from './painter.js';
import {GpuSurface} from './webgpu/surface.js';

/** A canvas with WebGL2. */
export class GlSurface {
  /** @param {HTMLCanvasElement} canvas */
  constructor(canvas) {
    const gl = canvas.getContext('webgl2', {alpha: false, antialias: false, depth: false, stencil: false,
                                            powerPreference: 'high-performance'});
    if (!gl) throw new L4DError('WEBGL2', 'this browser offers no WebGL2; another one may, or hardware acceleration is off in its settings');
    this.backend = /** @type {const} */ ('webgl2');
    this.canvas = canvas;
    this.gl = gl;
    this.onlost = () => {};
    this.onrestored = () => {};
    /** @type {(error: Error) => void} */
    this.onerror = () => {};
    canvas.addEventListener('webglcontextlost', this.#lost);
    canvas.addEventListener('webglcontextrestored', this.#restored);
  }

  /** @param {Event} event */
  #lost = event => {
    event.preventDefault();  // so that it is restored
    this.onlost();
  };
  #restored = () => this.onrestored();

  get isLost() { return this.gl.isContextLost(); }

  /** @param {import('./painter.js').PainterOptions} options */
  makePainter(options) { return new Painter(this.gl, options); }

  dispose() {
    this.canvas.removeEventListener('webglcontextlost', this.#lost);
    this.canvas.removeEventListener('webglcontextrestored', this.#restored);
  }
}

/**
 * WebGPU where there is some, WebGL2 otherwise, and why. `auto` does not take WebGPU that draws on the processor.
 * @param {HTMLCanvasElement} canvas @param {'auto' | 'webgpu'} wanted
 * @returns {Promise<{surface: GlSurface | GpuSurface, fallback: string | null}>}
 */
export const chooseSurface = async (canvas, wanted) => {
  try {
    return {surface: await GpuSurface.create(canvas, wanted === 'webgpu'), fallback: null};
  } catch (error) {
    return {surface: new GlSurface(canvas), fallback: /** @type {any} */ (error).message};
  }
};
