// SPDX-License-Identifier: Apache-2.0
import {frameOfTime} from 'l4dcodec';
import {OrbitCamera} from './camera.js';
import {Painter} from './painter.js';

const flatWindows = 1 << 10;  // among the tools of a stream

/**
 * @typedef {object} ViewOptions
 * @property {'auto' | '10' | '16f'} [target] bits of a channel while blending; auto: 16 where there are some
 * @property {[number, number, number]} [background] each 0 to 1
 * @property {boolean} [exact] draw only once the order of the instant and the camera is there (false: a frame late)
 * @property {number} [maxPixels] of the picture; more are not drawn, but scaled (2560 x 1440)
 * @property {() => Worker} [worker] makes the worker that sorts, for pages that bundle it themselves
 */

/** Shows a movie on a canvas. */
export class View {
  /** @param {HTMLCanvasElement} canvas @param {ViewOptions} [options] */
  constructor(canvas, options = {}) {
    this.canvas = canvas;
    this.options = options;
    const gl = canvas.getContext('webgl2', {alpha: false, antialias: false, depth: false, stencil: false,
                                            powerPreference: 'high-performance'});
    if (!gl) throw new Error('this browser has no WebGL2');
    this.gl = gl;
    this.orbit = new OrbitCamera();
    /** @type {import('./camera.js').Camera | null} */
    this.fixedCamera = null;
    this.background = options.background ?? [0, 0, 0];
    /** @type {import('l4dcodec').Movie | null} */
    this.movie = null;
    /** @type {Painter | null} */
    this.painter = null;
    this.sorter = options.worker?.() ?? new Worker(new URL('./sort-worker.js', import.meta.url), {type: 'module'});
    this.sorter.onmessage = event => this.#receive(event.data);
    /** @type {(() => void)[]} */
    this.ends = [];
    this.wanted = 0;   // counts changes of time, camera and rows
    this.sorting = 0;  // which of them is being sorted; 0: none
    this.sorted = 0;
    this.sortTime = 0;    // of what is being sorted
    this.orderTime = 0;   // of the order
    this.drawn = 0;
    this.needsDraw = false;
    /** @type {(() => void)[]} */
    this.waiting = [];
    /** @type {((bounds: any) => void)[]} */
    this.boundsWaiting = [];
    this.stats = {frames: 0, visible: 0, sortMs: 0, drawMs: 0, rows: 0};
    this.disposed = false;
    this.frameRequested = false;
    canvas.addEventListener('webglcontextlost', this.#lost);
    canvas.addEventListener('webglcontextrestored', this.#restored);
    this.observer = typeof ResizeObserver === 'function' ? new ResizeObserver(() => this.change()) : null;
    this.observer?.observe(canvas);
  }

  /** Shows this movie from now on. @param {import('l4dcodec').Movie} movie */
  show(movie) {
    this.hide();
    this.movie = movie;
    this.#makePainter();
    this.ends = [
      movie.on('rows', rows => this.#add(rows)),
      movie.on('removed', key => this.#remove(key)),
      movie.on('time', () => this.change())
    ];
    movie.refresh();
  }

  hide() {
    for (const end of this.ends.splice(0)) end();
    this.painter?.dispose();
    this.painter = null;
    this.movie = null;
    this.stats.rows = 0;
    this.sorter.postMessage({type: 'clear'});
  }

  /** The camera; null: that of `orbit`, which fits the canvas. @param {import('./camera.js').Camera | null} camera */
  setCamera(camera) {
    this.fixedCamera = camera;
    this.change();
  }

  /** Something is to be drawn anew. */
  change() {
    ++this.wanted;
    this.#request();
  }

  /** Looks at the scene as it is now. */
  async home() {
    const bounds = await this.bounds();
    if (bounds) this.orbit.frame(bounds, this.movie?.info.coordinateSystem ?? 0);
    this.change();
  }

  /** @returns {Promise<{middle: number[], extent: number[], radius: number} | null>} */
  bounds() {
    return new Promise(resolve => {
      this.boundsWaiting.push(resolve);
      const time = this.movie?.currentTime ?? 0;
      this.sorter.postMessage({type: 'bounds', time, frame: this.movie ? frameOfTime(this.movie.info, time) : 0});
    });
  }

  /** Resolves when the picture shows the time and the camera of now. @returns {Promise<void>} */
  settled() {
    if (this.drawn === this.wanted) return Promise.resolve();
    return new Promise(resolve => this.waiting.push(() => resolve()));
  }

  /** The settled picture: [height, width, 4], from the top. @returns {Promise<Uint8Array>} */
  async pixels() {
    const {gl, canvas: {width, height}} = this;
    // What was drawn in an earlier task is not there any more.
    if (this.drawn === this.wanted) this.change();
    await this.settled();
    const rows = new Uint8Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, rows);
    const out = new Uint8Array(rows.length);
    for (let y = 0; y < height; ++y) {
      out.set(rows.subarray(4 * width * y, 4 * width * (y + 1)), 4 * width * (height - 1 - y));
    }
    return out;
  }

  dispose() {
    this.hide();
    this.disposed = true;
    this.sorter.terminate();
    this.observer?.disconnect();
    this.canvas.removeEventListener('webglcontextlost', this.#lost);
    this.canvas.removeEventListener('webglcontextrestored', this.#restored);
  }

  #makePainter() {
    const {info, maxRows} = /** @type {import('l4dcodec').Movie} */ (this.movie);
    this.painter = new Painter(this.gl, {maxRows, shDegree: info.shDegree, target: this.options.target ?? 'auto'});
  }

  /** @param {Event} event */
  #lost = event => {
    event.preventDefault();  // so that it is restored
    this.painter = null;
  };

  #restored = () => {
    if (!this.movie) return;
    this.sorter.postMessage({type: 'clear'});
    this.stats.rows = 0;
    this.#makePainter();
    this.movie.refresh();
  };

  /** @param {import('l4dcodec').BucketRows} rows */
  #add(rows) {
    if (!this.painter) return;
    const lines = this.painter.store.add(rows);
    if (!lines) return this.movie?.emit('error', new Error('more Gaussians than the view has room for'));
    const {key, geometry, center} = rows;
    this.sorter.postMessage({type: 'add', key, geometry, lines, center}, [geometry.buffer]);
    this.change();
  }

  /** @param {string} key */
  #remove(key) {
    this.painter?.store.remove(key);
    this.sorter.postMessage({type: 'remove', key});
    this.change();
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

  #request() {
    if (this.frameRequested || this.disposed) return;
    this.frameRequested = true;
    requestAnimationFrame(() => {
      this.frameRequested = false;
      this.#frame();
    });
  }

  #frame() {
    if (this.disposed || !this.painter || !this.movie || this.gl.isContextLost()) return;
    const began = performance.now();
    this.#size();
    const camera = this.camera();
    const time = this.movie.currentTime;
    if (this.sorting === 0 && this.sorted !== this.wanted) {
      const m = camera.worldToCamera;
      this.sorting = this.wanted;
      this.sortTime = time;
      this.sorter.postMessage({type: 'sort', id: this.sorting,
                               sight: {time, frame: frameOfTime(this.movie.info, time),
                                       depth: [m[8], m[9], m[10], m[11]], nearPlane: camera.nearPlane}});
    }
    if (this.options.exact && this.sorted !== this.wanted) return;
    // Nothing in the order of a frame may be seen in the next one, so that all is late there.
    const shown = (this.movie.info.tools & flatWindows) !== 0 && this.painter.count > 0 ? this.orderTime : time;
    this.painter.draw(camera, shown, frameOfTime(this.movie.info, shown), this.canvas.width, this.canvas.height,
                      this.background);
    this.stats.drawMs = performance.now() - began;
    ++this.stats.frames;
    if (this.sorted === this.wanted) {
      this.drawn = this.wanted;
      for (const wake of this.waiting.splice(0)) wake();
    }
  }

  /** @param {any} data */
  #receive(data) {
    if (data.type === 'bounds') return this.boundsWaiting.shift()?.(data.bounds);
    this.sorting = 0;
    this.sorted = data.id;
    this.orderTime = this.sortTime;
    this.stats.sortMs = data.ms;
    this.stats.visible = data.count;
    this.painter?.setOrder(data.order, data.count);
    this.sorter.postMessage({type: 'return', order: data.order}, [data.order.buffer]);
    this.#request();
  }
}
