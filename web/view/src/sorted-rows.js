// SPDX-License-Identifier: Apache-2.0
import {inlined, startWorker, workerError} from 'l4dcodec';
import {Painter} from './painter.js';

/** @typedef {import('./painter.js').Painter | import('./webgpu/painter.js').GpuPainter} AnyPainter */

/** The rows of a movie in a painter, and the order in which they are drawn: what all that shows movies is made of. */
export class SortedRows {
  /** @param {{exact?: boolean, worker?: () => Worker}} options as those of a view */
  constructor(options) {
    this.isExact = options.exact ?? false;
    /** @type {import('l4dcodec').Movie | null} */
    this.movie = null;
    /** @type {AnyPainter | null} */
    this.painter = null;
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
    this.stats = {frames: 0, visible: 0, sortMs: 0, drawMs: 0, rows: 0};
    /** Rows of each bucket. @type {Map<string, number>} */
    this.rows = new Map();
    this.disposed = false;
    this.sorter = options.worker?.() ?? startWorker(() => new Worker(new URL('./sort-worker.js', import.meta.url), {type: 'module'}),
                                                    inlined.sortWorker, 'sort-worker.js', import.meta.url);
    this.sorter.onmessage = event => this.#receive(event.data);
    this.sorter.onerror = event => void workerError(this.sorter, event).then(error => this.#fail(error));
  }

  // ---- what those that draw do their own way

  /** What draws; null where it cannot now. @param {import('./painter.js').PainterOptions} options @returns {AnyPainter | null} */
  makePainter(options) {
    void options;
    return null;
  }

  /** @param {AnyPainter} painter @param {import('l4dcodec').BucketRows} rows */
  upload(painter, rows) { return painter.store.add(rows); }

  /** @param {Painter} painter @param {Uint32Array} order @param {number} count */
  uploadOrder(painter, order, count) { painter.setOrder(order, count); }

  /** A picture is to be drawn soon. */
  request() {}

  /** The camera, as far as the order depends on it. @returns {{worldToCamera: number[], nearPlane: number}} */
  camera() { throw new Error('no camera'); }

  // ---- what they use

  /** Shows this movie from now on. @param {import('l4dcodec').Movie} movie */
  show(movie) {
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

  /** Something is to be drawn anew. */
  change() {
    ++this.wanted;
    this.request();
  }

  /** @returns {Promise<{middle: number[], radius: number} | null>} */
  bounds() { return this.ask({type: 'bounds', streams: this.movie?.streamsAt(this.movie.currentTime) ?? []}); }

  /** What the sorter answers; null after the end. @param {object} question @returns {Promise<any>} */
  ask(question) {
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

  /** Whether there is a picture to draw; asks for the order of now. */
  prepare() {
    const {painter, movie} = this;
    if (this.disposed || !painter || !movie || this.refilling) return false;
    // What comes of an instant one by one is no picture yet.
    const isReady = movie.ready.detail !== 'none' || movie.hasFailed;
    if (painter.sorts && !isReady) return false;
    if (painter.sorts) {
      this.sorted = this.wanted;
      this.order.streams = movie.streamsAt(movie.currentTime);
    } else {
      if (isReady && this.sorting === 0 && this.sorted !== this.wanted) this.#sort(painter.store.gone, movie);
      if (!painter.store.isWhole(this.order.gone, this.order.firstLines)) return false;
    }
    return !this.isExact || this.sorted === this.wanted;
  }

  /** The picture that prepare() spoke of was drawn. @param {number} began when */
  finish(began) {
    this.stats.drawMs = performance.now() - began;
    ++this.stats.frames;
    this.drawn = this.sorted;
    // While a movie plays, an order is seldom that of the last change.
    const isDrawn = (/** @type {{wanted: number}} */ {wanted}) => wanted <= this.drawn;
    const drawn = this.waiting.filter(isDrawn);
    this.waiting = this.waiting.filter(waiting => !isDrawn(waiting));
    for (const {wake} of drawn) wake();
  }

  dispose() {
    this.hide();
    this.disposed = true;
    this.sorter.terminate();
    for (const {resolve} of this.asking.splice(0)) resolve(null);
  }

  /** @param {import('l4dcodec').L4DError} error */
  #fail(error) {
    if (this.disposed) return;
    this.failure = error;
    for (const {reject} of [...this.asking.splice(0), ...this.waiting.splice(0)]) reject(error);
    this.movie?.emit('error', error);
  }

  #makePainter() {
    if (!this.movie) return;
    const {info: {shDegree, rendering}, maxRows} = this.movie;
    this.painter = this.makePainter({maxRows, shDegree, rendering});
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
  restored() {
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
    this.restored();
    this.refilling = {...ready, hasBegun: false};
    this.change();
  }

  /** @param {{detail: string, tier: number, id?: number}} ready */
  #ready(ready) {
    this.#refilled(ready);
    this.request();
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
    const lines = this.upload(this.painter, rows);
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

  /** Asks for the order of now. @param {number} gone buckets @param {import('l4dcodec').Movie} movie */
  #sort(gone, movie) {
    const sight = this.sight(movie);
    this.sorting = this.wanted;
    this.asked = {streams: sight.streams, gone};
    this.sorter.postMessage({type: 'sort', id: this.sorting, sight});
  }

  /** What is seen now, and from where. @param {import('l4dcodec').Movie} movie @returns {import('./sorter.js').Sight} */
  sight(movie) {
    const {worldToCamera: m, nearPlane} = this.camera();
    return {streams: movie.streamsAt(movie.currentTime), depth: [m[8], m[9], m[10], m[11]], nearPlane,
            minAlpha: movie.info.rendering.minAlpha};
  }

  /** @param {any} data */
  #receive(data) {
    if (data.type === 'answer') return this.asking.shift()?.resolve(data.answer);
    if (data.id === this.sorting) this.#setOrder(data);
    this.sorter.postMessage({type: 'return', order: data.order}, [data.order.buffer]);
    this.request();
  }

  /** @param {{id: number, order: Uint32Array, count: number, firstLines: number[], ms: number}} sorted */
  #setOrder({id, order, count, firstLines, ms}) {
    const {painter, asked} = this;
    this.sorting = 0;
    if (!(painter instanceof Painter)) return;
    const lines = new Set(firstLines);
    // Where others lie now, the order before may still be good.
    if (!painter.store.isWhole(asked.gone, lines)) return;
    this.uploadOrder(painter, order, count);
    painter.store.release(asked.gone);
    this.sorted = id;
    this.order = {...asked, firstLines: lines};
    this.stats.sortMs = ms;
    this.stats.visible = count;
  }
}
