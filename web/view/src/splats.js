// SPDX-License-Identifier: Apache-2.0
// Streams in the scenes of engines: on their WebGL2 context, among what they draw.
import {Movie, open} from 'l4dcodec';
import {cross, dot} from './camera.js';
import {keepState} from './gl-state.js';
import {OverPainter} from './over-painter.js';
import {SortedRows} from './sorted-rows.js';

/** @typedef {ArrayLike<number>} Matrix [4, 4], by columns, as WebGL has them */
/**
 * @typedef {object} EngineView where from, and into what: the viewport of the framebuffer that is bound
 * @property {Matrix} modelView from the stream to the camera, which looks along -z or z, y up
 * @property {Matrix} projection of perspective @property {number} near its near plane
 * @property {boolean} [isSet] the engine has set what depends on the material: blending of premultiplied alpha (one, one minus source
 *   alpha), depth that is less or equal, or greater where it is reversed, which is not written, and no masks. Else it is read and put back,
 *   for which a browser waits a millisecond (false)
 * @property {boolean} [isLinear] the framebuffer holds linear light (false)
 * @property {boolean} [isReversed] depth is greater where it is nearer (false)
 */

/** @typedef {Movie | string | URL | Blob | ArrayBuffer | ArrayBufferView} Source a movie stays the caller's */
/** @typedef {import('l4dcodec').OpenOptions & {sortWorker?: () => Worker}} SplatOptions those of `open`; sortWorker: makes the worker that sorts */

/** @param {Matrix} m @param {number} k @param {number} sign @returns {[number, number, number, number]} */
const row = (m, k, sign) => [sign * m[k], sign * m[4 + k], sign * m[8 + k], sign * m[12 + k]];
/** Of the axis that a camera looks along: 1 or -1. @param {Matrix} projection */
const ahead = projection => projection[11] < 0 ? -1 : 1;

/** @param {EngineView} view @param {number} width pixels @param {number} height @returns {import('./camera.js').Camera} */
export const cameraOf = ({modelView, projection: p, near}, width, height) => {
  const z = ahead(p), y = p[5] < 0 ? 1 : -1;
  const rows = [row(modelView, 0, 1), row(modelView, 1, y), row(modelView, 2, z)];
  const [a, b, c] = /** @type {import('./camera.js').Vec3[]} */ (rows.map(r => r.slice(0, 3)));
  // The engine may scale what it shows.
  const inverse = [cross(b, c), cross(c, a), cross(a, b)];
  const det = dot(a, inverse[0]);
  const center = /** @type {import('./camera.js').Vec3} */ ([0, 1, 2].map(k => -rows.reduce((sum, r, i) => sum + r[3] * inverse[i][k], 0) / det));
  return {
    worldToCamera: rows.flat(), center, nearPlane: near,
    fx: width / 2 * p[0], fy: height / 2 * Math.abs(p[5]), cx: width / 2 * (1 + z * p[8]), cy: height / 2 * (1 - z * p[9]),
    depths: [z * p[10], p[14]]
  };
};

/** Draws a movie by the rules of `l4dcodec render` on the context of an engine, whose state stays as it is. */
export class Splats extends SortedRows {
  /** @param {Source} source @param {SplatOptions} [options] */
  constructor(source, {sortWorker, ...options} = {}) {
    super({worker: sortWorker});
    this.source = source;
    /** @type {import('l4dcodec').OpenOptions} */
    this.options = options;
    /** @type {Promise<Movie> | null} */
    this.loading = null;
    /** @type {WebGL2RenderingContext | null} */
    this.gl = null;
    this.seen = {worldToCamera: Array(12).fill(0), nearPlane: 0};
    /** Called when another picture would show something new, for pages that draw on request. */
    this.onchange = () => {};
  }

  /** Opens the stream. Resolves to its movie when the first instant can be shown. */
  load() {
    this.loading ??= this.#load();
    return this.loading;
  }

  async #load() {
    const {source} = this;
    if (source instanceof Movie) {
      this.show(source);
      return source;
    }
    const movie = await open(source, this.options);
    if (this.disposed) {
      movie.dispose();
      throw new DOMException('disposed', 'AbortError');
    }
    this.show(movie);
    await movie.seek(movie.startTime);
    return movie;
  }

  /**
   * Draws over what the engine has drawn, where that is not nearer. To be called after opaque objects.
   * @param {WebGL2RenderingContext} gl @param {EngineView} view @param {EngineView[]} [views] all of this picture, as of both
   *   eyes: they have the same order
   */
  draw(gl, view, views = [view]) {
    if (gl !== this.gl) this.#use(gl);
    this.#look(views);
    const began = performance.now();
    const {painter} = this;
    if (gl.isContextLost() || !this.prepare() || !(painter instanceof OverPainter)) return;
    keepState(gl, () => painter.drawOver((width, height) => cameraOf(view, width, height), this.order.streams, view), !view.isSet);
    this.finish(began);
  }

  hide() {
    if (this.gl) keepState(this.gl, () => super.hide());
    else super.hide();
  }

  /** Frees what it has of the GPU and ends its workers, and the movie that it opened. */
  dispose() {
    const {movie} = this;
    super.dispose();
    this.#use(null);
    if (movie !== this.source) movie?.dispose();
  }

  /** @param {import('./painter.js').PainterOptions} options */
  makePainter(options) {
    const {gl} = this;
    return gl && !gl.isContextLost() ? keepState(gl, () => new OverPainter(gl, options)) : null;
  }

  /** @param {OverPainter} painter @param {import('l4dcodec').BucketRows} rows */
  upload(painter, rows) { return keepState(painter.gl, () => super.upload(painter, rows)); }

  /** @param {OverPainter} painter @param {Uint32Array} order @param {number} count */
  uploadOrder(painter, order, count) { keepState(painter.gl, () => super.uploadOrder(painter, order, count)); }

  request() { this.onchange(); }
  camera() { return this.seen; }

  /** @param {WebGL2RenderingContext | null} gl */
  #use(gl) {
    for (const [name, listen] of /** @type {[string, () => void][]} */ ([['webglcontextlost', this.#lost], ['webglcontextrestored', this.#restored]])) {
      this.gl?.canvas.removeEventListener(name, listen);
      gl?.canvas.addEventListener(name, listen);
    }
    if (this.gl) keepState(this.gl, () => this.painter?.dispose());
    this.painter = null;
    this.gl = gl;
    if (gl) this.restored();
  }

  #lost = () => { this.painter = null; };
  #restored = () => this.restored();

  /** The order is that of the mean depth over all views. @param {EngineView[]} views */
  #look(views) {
    const depth = [0, 0, 0, 0];
    for (const {modelView, projection} of views) {
      for (const [k, v] of row(modelView, 2, ahead(projection)).entries()) depth[k] += v / views.length;
    }
    const before = this.seen.worldToCamera;
    const [{near: nearPlane}] = views;
    if (nearPlane === this.seen.nearPlane && depth.every((v, k) => v === before[8 + k])) return;
    this.seen = {worldToCamera: [...before.slice(0, 8), ...depth], nearPlane};
    ++this.wanted;
  }
}
