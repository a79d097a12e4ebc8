// SPDX-License-Identifier: Apache-2.0
import {inlined, startWorker, workerError} from 'l4dcodec';
import {OrbitCamera, rayOf} from './camera.js';
import {Painter} from './painter.js';
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
export class View {
  /** @param {HTMLCanvasElement} canvas @param {ViewOptions} [options] */
  constructor(canvas, options = {}) {
    this.canvas = canvas;
    this.options = options;
    this.orbit = new OrbitCamera();
    /** @type {import('./camera.js').Camera | null} */
    this.fixedCamera = null;
    this.background = options.background ?? [0, 0, 0];
    /** @type {import('l4dcodec').Movie | null} */
    this.movie = null;
    /** @type {import('./painter.js').Painter | import('./webgpu/painter.js').GpuPainter | null} */
    this.painter = null;
    /** @type {GlSurface | import('./webgpu/surface.js').GpuSurface | null} */
    this.surface = null;
    /** @type {string | null} why it is not the back end that was wanted */
    this.fallback = null;
    /** @type {(() => void)[]} */
    this.ends = [];
    this.wanted = 0;   // counts changes of time, camera and rows
    this.sorting = 0;  // which of them is being sorted; 0: none
    this.sorted = 0;
    /** What is being sorted: the streams of its time, and how many buckets had gone. */
    this.asked = {streams: /** @type {import('l4dcodec').StreamTime[]} */ ([]), gone: 0};
    /** The same of the order, and the first lines of its buckets. */
    this.order = {...this.asked, firstLines: new Set()};
    this.drawn = 0;
    this.needsDraw = false;
    /** What was shown before all rows were sent for again: until it is here, the picture stays. @type {any} */
    this.refilling = null;
    /** For what of `wanted` to be drawn. @type {{wanted: number, wake: () => void, reject: (reason: any) => void}[]} */
    this.waiting = [];
    /**
     * For answers of the sorter, which come in the order of what it was asked.
     * @type {{resolve: (answer: any) => void, reject: (reason: any) => void}[]}
     */
    this.asking = [];
    /** Why the sorter does not work. Then nothing is drawn any more. @type {import('l4dcodec').L4DError | null} */
    this.failure = null;
    /** Called when a picture was drawn. */
    this.ondraw = () => {};
    this.stats = {frames: 0, visible: 0, sortMs: 0, drawMs: 0, rows: 0};
    /** Rows of each bucket. @type {Map<string, number>} */
    this.rows = new Map();
    this.disposed = false;
    this.frameRequested = false;
    const {backend = 'webgl2'} = options;
    // What cannot draw has no worker.
    const surface = backend === 'webgl2' ? new GlSurface(canvas) : null;
    this.sorter = options.worker?.() ?? startWorker(() => new Worker(new URL('./sort-worker.js', import.meta.url), {type: 'module'}),
                                                    inlined.sortWorker, 'sort-worker.js', import.meta.url);
    this.sorter.onmessage = event => this.#receive(event.data);
    this.sorter.onerror = event => void workerError(this.sorter, event).then(error => this.#fail(error));
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
    surface.onrestored = () => this.#restored();
    surface.onerror = error => this.movie?.emit('error', error);
    this.#restored();
    return surface.backend;
  }

  /** Shows this movie from now on; resolves when it is known what draws. @param {import('l4dcodec').Movie} movie */
  async show(movie) {
    if (this.failure) throw this.failure;
    this.hide();
    this.movie = movie;
    this.#makePainter();
    this.ends = [
      movie.on('rows', rows => this.#add(rows)),
      movie.on('removed', key => this.#remove(key)),
      movie.on('time', () => this.change()),
      movie.on('info', () => this.#widen()),
      movie.on('refreshed', () => { if (this.refilling) this.refilling.hasBegun = true; }),
      movie.on('ready', ready => this.#ready(ready)),
      movie.on('error', () => this.change())
    ];
    movie.refresh();
    await this.ready;
  }

  hide() {
    for (const end of this.ends.splice(0)) end();
    this.painter?.dispose();
    this.painter = null;
    this.movie = this.refilling = null;
    this.#count(null);
    this.#clearOrder();
    for (const {wake} of this.waiting.splice(0)) wake();
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

  /** Looks as the stream suggests, or at its bounds, or at the scene as it is now. */
  async home() {
    const {camera, bounds: box} = this.movie?.info.presentation ?? {};
    const bounds = camera ? null : box ? boundsOf(box) : await this.bounds();
    if (camera) this.orbit.place(camera);
    if (bounds) this.orbit.frame(bounds, this.movie?.info.coordinateSystem ?? 0);
    this.change();
  }

  /** @returns {Promise<{middle: number[], radius: number} | null>} */
  bounds() { return this.#ask({type: 'bounds', streams: this.movie?.streamsAt(this.movie.currentTime) ?? []}); }

  /**
   * The position in the scene that is seen at a pixel of the canvas, from its upper left corner; null: nothing is.
   * @param {number} x @param {number} y @returns {Promise<import('./camera.js').Vec3 | null>}
   */
  positionAt(x, y) {
    if (!this.movie) return Promise.resolve(null);
    return this.#ask({type: 'pick', sight: this.#sight(this.movie), ray: rayOf(this.camera(), x, y)});
  }

  /** What the sorter answers; null after the end. @param {object} question @returns {Promise<any>} */
  #ask(question) {
    if (this.disposed) return Promise.resolve(null);
    if (this.failure) return Promise.reject(this.failure);
    return new Promise((resolve, reject) => {
      this.asking.push({resolve, reject});
      this.sorter.postMessage(question);
    });
  }

  /**
   * Resolves when the picture shows the time and the camera of now or of later, as while a movie plays, or there is
   * nothing to show. @returns {Promise<void>}
   */
  settled() {
    if (this.drawn === this.wanted || this.disposed || !this.movie) return Promise.resolve();
    if (this.failure) return Promise.reject(this.failure);
    return new Promise((resolve, reject) => this.waiting.push({wanted: this.wanted, wake: () => resolve(), reject}));
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
    this.hide();
    this.disposed = true;
    this.sorter.terminate();
    for (const {resolve} of this.asking.splice(0)) resolve(null);
    this.observer?.disconnect();
    this.surface?.dispose();
  }

  /** @param {import('l4dcodec').L4DError} error */
  #fail(error) {
    if (this.disposed) return;
    this.failure = error;
    for (const {reject} of [...this.asking.splice(0), ...this.waiting.splice(0)]) reject(error);
    this.movie?.emit('error', error);
  }

  #makePainter() {
    // A lost context has room for nothing; once it is back, this is called again.
    if (!this.surface || !this.movie || this.surface.isLost) return;
    const {info, maxRows} = this.movie;
    this.painter = this.surface.makePainter({maxRows, shDegree: info.shDegree, target: this.options.target ?? 'auto',
                                             rendering: info.rendering});
    if ('oncount' in this.painter) this.painter.oncount = count => { this.stats.visible = count; };
  }

  /** The sorter forgets all rows. An order that is on its way is of rows that are not there any more. */
  #clearOrder() {
    this.sorter.postMessage({type: 'clear'});
    this.sorting = 0;
    ++this.wanted;
    this.asked = {streams: [], gone: 0};
    this.order = {...this.asked, firstLines: new Set()};
  }

  /** All that was uploaded is gone, or nothing was yet. */
  #restored() {
    if (!this.movie) return;
    this.#clearOrder();
    this.#count(null);
    this.#makePainter();
    this.movie.refresh();
  }

  /** Another stream of the movie may have more rows, or colours of a higher degree. */
  #widen() {
    const {painter, movie} = this;
    if (!painter || !movie || movie.info.shDegree === painter.degree && movie.maxRows <= painter.maxRows) return;
    const {ready} = movie;
    painter.dispose();
    this.#restored();
    this.refilling = {...ready, hasBegun: false};
    this.change();
  }

  /** @param {{detail: string, tier: number, id?: number}} ready */
  #ready(ready) {
    this.#refilled(ready);
    this.#request();
  }

  /** @param {{detail: string, tier: number, id?: number}} ready */
  #refilled({detail, tier, id}) {
    const {refilling, movie} = this;
    if (!refilling?.hasBegun || !movie) return;
    const isLess = detail !== refilling.detail && detail !== 'full' || tier < refilling.tier;
    // Who plays, or has sought, sees what there is.
    if (isLess && movie.paused && id === refilling.id) return;
    this.refilling = null;
    this.change();
  }

  /** @param {import('l4dcodec').BucketRows} rows */
  #add(rows) {
    if (!this.painter) return;
    const lines = this.painter.store.add(rows);
    if (!lines) return this.movie?.emit('error', new Error('more Gaussians than the view has room for'));
    const {key, geometry, center, stream} = rows;
    this.#count(key, rows.count);
    // Another view, or an adapter, may want them too.
    const isAlone = this.movie?.listeners.get('rows')?.size === 1;
    this.sorter.postMessage({type: 'add', key, geometry, lines, center, stream}, isAlone ? [geometry.buffer] : []);
    this.change();
  }

  /** @param {string} key */
  #remove(key) {
    this.painter?.store.remove(key);
    this.#count(key);
    this.sorter.postMessage({type: 'remove', key});
    this.change();
  }

  /** @param {string | null} key of a bucket that has come or gone, null: all have gone @param {number} [count] */
  #count(key, count = 0) {
    if (key === null) this.rows.clear();
    else if (count > 0) this.rows.set(key, count);
    else this.rows.delete(key);
    this.stats.rows = [...this.rows.values()].reduce((sum, n) => sum + n, 0);
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
    if (this.disposed || !this.painter || !this.movie || !this.surface || this.surface.isLost || this.refilling) return;
    const began = performance.now();
    const {painter, movie} = this;
    // What comes of an instant one by one is no picture yet.
    const isReady = movie.ready.detail !== 'none' || movie.hasFailed;
    if (painter.sorts && !isReady) return;
    if (painter.sorts) {
      this.sorted = this.wanted;
      this.order.streams = movie.streamsAt(movie.currentTime);
    } else {
      if (isReady && this.sorting === 0 && this.sorted !== this.wanted) this.#sort(painter.store.gone, movie);
      if (!painter.store.isWhole(this.order.gone, this.order.firstLines)) return;
    }
    if (this.options.exact && this.sorted !== this.wanted) return;
    this.#size();
    // An order lists what is seen at its own time: at another one, some of the picture would lack, or all of it.
    painter.draw(this.camera(), this.order.streams, this.canvas.width, this.canvas.height, this.background);
    this.stats.drawMs = performance.now() - began;
    ++this.stats.frames;
    this.drawn = this.sorted;
    // While a movie plays, an order is seldom that of the last change.
    const isDrawn = (/** @type {{wanted: number}} */ {wanted}) => wanted <= this.drawn;
    const drawn = this.waiting.filter(isDrawn);
    this.waiting = this.waiting.filter(waiting => !isDrawn(waiting));
    for (const {wake} of drawn) wake();
    this.ondraw();
  }

  /** Asks for the order of now. @param {number} gone buckets @param {import('l4dcodec').Movie} movie */
  #sort(gone, movie) {
    const sight = this.#sight(movie);
    this.sorting = this.wanted;
    this.asked = {streams: sight.streams, gone};
    this.sorter.postMessage({type: 'sort', id: this.sorting, sight});
  }

  /** What is seen now, and from where. @param {import('l4dcodec').Movie} movie */
  #sight(movie) {
    const {worldToCamera: m, nearPlane} = this.camera();
    return {streams: movie.streamsAt(movie.currentTime), depth: [m[8], m[9], m[10], m[11]], nearPlane,
            minAlpha: movie.info.rendering.minAlpha};
  }

  /** @param {any} data */
  #receive(data) {
    if (data.type === 'answer') return this.asking.shift()?.resolve(data.answer);
    if (data.id === this.sorting) this.#setOrder(data);
    this.sorter.postMessage({type: 'return', order: data.order}, [data.order.buffer]);
    this.#request();
  }

  /** @param {{id: number, order: Uint32Array, count: number, firstLines: number[], ms: number}} sorted */
  #setOrder({id, order, count, firstLines, ms}) {
    const {painter, asked} = this;
    this.sorting = 0;
    if (!(painter instanceof Painter)) return;
    const lines = new Set(firstLines);
    // Where others lie now, the order before may still be good.
    if (!painter.store.isWhole(asked.gone, lines)) return;
    painter.setOrder(order, count);
    painter.store.release(asked.gone);
    this.sorted = id;
    this.order = {...asked, firstLines: lines};
    this.stats.sortMs = ms;
    this.stats.visible = count;
  }
}
