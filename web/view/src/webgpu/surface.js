// SPDX-License-Identifier: Apache-2.0
import {GpuPainter} from './painter.js';

const wantedBinding = 2 ** 28;               // bytes; all rows of 2^21 Gaussians with SH of degree 3 fit
const retryDelays = [0, 500, 2000, 5000];  // ms, after a device was lost

/** @param {boolean} software may it be an adapter that draws on the processor? */
const requestDevice = async software => {
  const gpu = globalThis.navigator?.gpu;
  if (!gpu) throw new Error('this browser has no WebGPU, or the page is not secure');
  const adapter = await gpu.requestAdapter({powerPreference: 'high-performance'});
  if (!adapter) throw new Error('WebGPU finds no adapter');
  const {info = adapter} = /** @type {any} */ (adapter);  // some have it here
  if (!software && info.isFallbackAdapter) throw new Error('WebGPU would draw on the processor');
  const {maxStorageBufferBindingSize, maxBufferSize} = adapter.limits;
  return adapter.requestDevice({requiredLimits: {
    maxStorageBufferBindingSize: Math.min(maxStorageBufferBindingSize, wantedBinding),
    maxBufferSize: Math.min(maxBufferSize, wantedBinding)
  }});
};

/** A canvas with WebGPU. A device that is lost is replaced by a new one. */
export class GpuSurface {
  /**
   * Throws where there is none. Only then can the canvas still be one of WebGL2.
   * @param {HTMLCanvasElement} canvas @param {boolean} software
   */
  static async create(canvas, software) {
    const device = await requestDevice(software);
    const context = /** @type {GPUCanvasContext | null} */ (/** @type {unknown} */ (canvas.getContext('webgpu')));
    if (context) return new GpuSurface(context, device, software);
    device.destroy();
    throw new Error('the canvas takes no WebGPU');
  }

  /** @param {GPUCanvasContext} context @param {GPUDevice} device @param {boolean} software */
  constructor(context, device, software) {
    this.backend = /** @type {const} */ ('webgpu');
    this.context = context;
    this.device = device;
    this.software = software;
    this.format = navigator.gpu.getPreferredCanvasFormat();
    this.isLost = false;
    this.disposed = false;
    this.onlost = () => {};
    this.onrestored = () => {};
    /** @type {(error: Error) => void} */
    this.onerror = () => {};
    this.#use(device);
  }

  /** @param {GPUDevice} device */
  #use(device) {
    this.device = device;
    this.isLost = false;
    this.context.configure({device, format: this.format, alphaMode: 'opaque'});
    device.onuncapturederror = ({error}) => this.onerror(new Error(`WebGPU: ${error.message}`));
    void device.lost.then(() => this.#lost());
  }

  async #lost() {
    if (this.disposed) return;
    this.isLost = true;
    this.onlost();
    let reason;
    for (const delay of retryDelays) {
      await new Promise(resolve => setTimeout(resolve, delay));
      if (this.disposed) return;
      try {
        this.#use(await requestDevice(this.software));
        return this.onrestored();
      } catch (error) {
        reason = error;
      }
    }
    this.onerror(new Error(`the graphics device was lost, and no other one comes: ${/** @type {any} */ (reason).message}`));
  }

  /** @param {import('../painter.js').PainterOptions} options */
  makePainter(options) { return new GpuPainter(this.device, this.context, this.format, options); }

  dispose() {
    this.disposed = true;
    this.context.unconfigure();
    this.device.destroy();
  }
}
