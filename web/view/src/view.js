// SPDX-License-Identifier: Apache-2.0
import {OrbitCamera, rayOf} from './camera.js';
import {SortedRows} from './sorted-rows.js';
import {chooseSurface, GlSurface} from './surface.js';

/**
 * @typedef {object} ViewOptions
 * @property {'webgl2' | 'webgpu' | 'auto'} [backend] what draws (webgl2); webgpu and auto: WebGL2 where there is no WebGPU,
 *   auto: also where WebGPU would draw on the processor
 * @property {'auto' | '10' | '16f'} [target] bits of a channel while blending; auto: 16 where there are some
 * @property {[number, number, number]} [background] each 0 to 1
 * @property {boolean} [exact] draw only once the order of the instant and the camera is there (false: with WebGL2, a
 *   frame late)
 * @property {number} [maxPixels] of the picture; more are not drawn, but scaled (2560 x 1440)
 * @property {() => Worker} [worker] makes the worker that sorts, for pages that bundle it themselves
 */

/** What a camera should look at. @param {{min: number[], max: number[]}} box */
const boundsOf = ({min, max}) => {
  return {middle: max.map((v, k) => (v + min[k]) / 2), radius: Math.hypot(...max.map((v, k) => v - min[k])) / 2};
};

/** Shows a movie on a canvas. */
export class View extends SortedRows {
  /** @param {HTMLCanvasElement} canvas @param {ViewOptions} [options] */
  constructor(canvas, options = {}) {
    const {backend = 'webgl2'} = options;
    // What cannot draw has no worker.
    const surface = backend === 'webgl2' ? new GlSurface(canvas) : null;
    super(options);
    this.canvas = canvas;
    this.options = options;
    this.orbit = new OrbitCamera();
    /** @type {import('./camera.js').Camera | null} */
    this.fixedCamera = null;
    this.background = options.background ?? [0, 0, 0];
    /** @type {GlSurface | import('./webgpu/surface.js').GpuSurface | null} */
    this.surface = null;
    /** @type {string | null} why it is not the back end that was wanted */
    this.fallback = null;
    /** Called when a picture was drawn. */
    this.ondraw = () => {};
    this.frameRequested = false;
    /** When it is known what draws. @type {Promise<'webgl2' | 'webgpu'>} */
    this.ready = surface ? Promise.resolve(this.#use(surface, null)) :
      chooseSurface(canvas, /** @type {'auto' | 'webgpu'} */ (backend)).then(({surface, fallback}) => this.#use(surface, fallback));
    this.ready.catch(() => {});
    this.observer = typeof ResizeObserver === 'function' ? new ResizeObserver(() => this.change()) : null;
    this.observer?.observe(canvas);
  }

  /** What draws; null where that is not known yet (`ready`). */
  get backend() { return this.surface?.backend ?? null; }
  /** The context, of WebGL2. */
  get gl() { return this.surface instanceof GlSurface ? this.surface.gl : null; }

  /** @param {GlSurface | import('./webgpu/surface.js').GpuSurface} surface @param {string | null} fallback */
  #use(surface, fallback) {
    if (this.disposed) {
      surface.dispose();
      return surface.backend;
    }
    this.surface = surface;
    this.fallback = fallback;
    surface.onlost = () => { this.painter = null; };
    surface.onrestored = () => this.restored();
    surface.onerror = error => this.movie?.emit('error', error);
    this.restored();
    return surface.backend;
  }

  /** Shows this movie from now on; resolves when it is known what draws. @param {import('l4dcodec').Movie} movie */
  async show(movie) {
    super.show(movie);
    await this.ready;
  }

  /** @param {import('./painter.js').PainterOptions} options */
  makePainter(options) {
    // A lost context has room for nothing; once it is back, this is called again.
    if (!this.surface || this.surface.isLost) return null;
    const painter = this.surface.makePainter({...options, target: this.options.target});
    if ('oncount' in painter) painter.oncount = count => { this.stats.visible = count; };
    return painter;
  }

  /** The camera; null: that of `orbit`, which fits the canvas. @param {import('./camera.js').Camera | null} camera */
  setCamera(camera) {
    this.fixedCamera = camera;
    this.change();
  }

  /** Looks as the stream suggests, or at its bounds, or at the scene as it is now. */
  async home() {
    const {camera, bounds: box} = this.movie?.info.presentation ?? {};
    const bounds = camera ? null : box ? boundsOf(box) : await this.bounds();
    if (camera) this.orbit.place(camera);
    if (bounds) this.orbit.frame(bounds, this.movie?.info.coordinateSystem ?? 0);
    this.change();
  }

  /**
   * The position in the scene that is seen at a pixel of the canvas, from its upper left corner; null: nothing is.
   * @param {number} x @param {number} y @returns {Promise<import('./camera.js').Vec3 | null>}
   */
  positionAt(x, y) {
    if (!this.movie) return Promise.resolve(null);
    return this.ask({type: 'pick', sight: this.sight(this.movie), ray: rayOf(this.camera(), x, y)});
  }

  /**
   * The settled picture: [height, width, 4], from the top. Of another size than the canvas has, `orbit` must be its camera.
   * @param {number} [width] @param {number} [height] @returns {Promise<Uint8Array>}
   */
  async pixels(width, height) {
    // What was drawn in an earlier task is not there any more.
    if (this.drawn === this.wanted) this.change();
    await this.settled();
    const {canvas, painter} = this;
    if (!this.movie || !painter) throw new Error('nothing is shown');
    const before = {width: canvas.width, height: canvas.height};
    const wanted = {width: width ?? before.width, height: height ?? before.height};
    if (wanted.width === before.width && wanted.height === before.height) return painter.pixels();
    // Nobody sees it: within this task, the canvas gets its own picture back.
    const draw = (/** @type {typeof before} */ size) => {
      Object.assign(canvas, size);
      painter.draw(this.camera(), this.order.streams, size.width, size.height, this.background);
    };
    draw(wanted);
    const pixels = painter.pixels();
    draw(before);
    return pixels;
  }

  dispose() {
    super.dispose();
    this.observer?.disconnect();
    this.surface?.dispose();
  }

  #size() {
    const {canvas} = this;
    if (this.fixedCamera) return;
    const ratio = globalThis.devicePixelRatio || 1;
    let width = canvas.clientWidth * ratio, height = canvas.clientHeight * ratio;
    const most = this.options.maxPixels ?? 2560 * 1440;
    const scale = Math.min(1, Math.sqrt(most / Math.max(width * height, 1)));
    width = Math.max(Math.round(width * scale), 1);
    height = Math.max(Math.round(height * scale), 1);
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, {width, height});
  }

  camera() { return this.fixedCamera ?? this.orbit.camera(this.canvas.width, this.canvas.height); }

  request() {
    if (this.frameRequested || this.disposed) return;
    this.frameRequested = true;
    requestAnimationFrame(() => {
      this.frameRequested = false;
      this.#frame();
    });
  }

  #frame() {
    if (this.surface?.isLost) return;
    const began = performance.now();
    if (!this.prepare()) return;
    this.#size();
    // An order lists what is seen at its own time: at another one, some of the picture would lack, or all of it.
    this.painter?.draw(this.camera(), this.order.streams, this.canvas.width, this.canvas.height, this.background);
    this.finish(began);
    this.ondraw();
  }
}
