// SPDX-License-Identifier: Apache-2.0
// The decoder, web/wasm/bridge.cc, over a store of bytes that may lack some: calls answer undefined
// where bytes lack, and store.missed() says which.
import {L4DError, statusError} from './errors.js';

export const infoFields = /** @type {const} */ ([
  'formatMajor', 'formatMinor', 'shDegree', 'tools', 'numLayers', 'numGaussians', 'fileBytes', 'timeBegin',
  'numFrames', 'rateNumerator', 'rateDenominator', 'duration', 'coordinateSystem', 'colorSpace', 'profile', 'level', 'lastTier'
]);

/**
 * @typedef {object} Rendering how the scene asks to be drawn (section 8.6 of the specification)
 * @property {number} dilation pixels^2, added to both variances of a splat
 * @property {number} cutoff standard deviations at which a splat ends; 0: at minAlpha alone
 * @property {number} minAlpha below which a splat adds nothing @property {number} maxAlpha to which alpha is clamped
 * @property {boolean} compensation whether opacity makes up for dilation
 */
/** @typedef {[number, number, number]} Vector */
/**
 * @typedef {object} Presentation how it asks to be shown (section 8.7); null: it does not say
 * @property {'once' | 'loop' | 'ping-pong' | null} playback
 * @property {{min: Vector, max: Vector} | null} bounds of what is worth looking at
 * @property {{position: Vector, target: Vector, up: Vector, fov: number} | null} camera the first one; `fov` is vertical, in
 *   radians
 * @property {number | null} metresPerUnit
 */
/**
 * @typedef {{[K in typeof infoFields[number]]: number} &
 *   {frameRate: number, rendering: Rendering, presentation: Presentation}} Info
 */
const playbacks = /** @type {const} */ ([null, 'once', 'loop', 'ping-pong']);
/** @typedef {{layer: number, bucket: number, count: number, center: number, width: number, level: number}} Bucket */
/**
 * @typedef {object} Rows what of a bucket does not change with time (web/wasm/rows.h)
 * @property {number} count
 * @property {number} shStride binary16 numbers from one row to the next
 * @property {number} center seconds; times of rows are relative to it
 * @property {Float32Array} geometry [count, 16]; a negative last number of a row: a flat window (timeline.js)
 * @property {Uint16Array} sh [count, shStride]
 */

export const steps = {pageTables: 0, directory: 1, all: 2};
export const details = {full: 0, base: 1};
const all = 0xffffffff;

/**
 * What of a stream is wanted: levels up to maxLevel and tiers up to maxTier, all where they are not given.
 * @typedef {{maxLevel?: number, maxTier?: number, detail?: number}} Part
 */

/** @type {Map<number, import('./store.js').ByteStore>} */
const stores = new Map();
let nextStream = 1;

/**
 * Compiles once; instances share the code and nothing else.
 * @param {BufferSource | Response | Promise<Response>} source of l4d.wasm
 */
export const compile = async source => {
  const it = await source;
  if (it instanceof Response) {
    if (!it.ok) throw statusError(it.url, it.status);
    return WebAssembly.compile(await it.arrayBuffer());
  }
  return WebAssembly.compile(it);
};

/** Decoders of one instance share its memory, and are called one at a time. @param {WebAssembly.Module} module */
export const instantiate = async module => {
  /** @type {WebAssembly.Instance} */
  let instance;
  const memory = () => /** @type {WebAssembly.Memory} */ (instance.exports.memory);
  instance = await WebAssembly.instantiate(module, {
    l4d: {
      read_at: (/** @type {number} */ id, /** @type {number} */ to, /** @type {number} */ n,
                /** @type {number} */ offset) =>
        stores.get(id)?.read(offset, new Uint8Array(memory().buffer, to >>> 0, n >>> 0)) ?? -1
    },
    env: {emscripten_notify_memory_growth() {}},
    wasi_snapshot_preview1: {
      proc_exit(/** @type {number} */ code) { throw new L4DError('INTERNAL', `the decoder ended (${code})`); },
      fd_close: () => 0
    }
  });
  /** @type {any} */ (instance.exports)._initialize?.();
  return instance;
};

export class Decoder {
  /** @param {WebAssembly.Instance} instance @param {import('./store.js').ByteStore} store @param {number} stream */
  constructor(instance, store, stream) {
    this.wasm = /** @type {any} */ (instance.exports);
    this.store = store;
    this.stream = stream;
    this.handle = 0;
  }

  /**
   * @param {WebAssembly.Module | WebAssembly.Instance} code @param {import('./store.js').ByteStore} store
   * @param {{maxMemoryBytes?: number, cacheBytes?: number, tolerant?: boolean, acceptNeeds?: boolean}} [options]
   * acceptNeeds: the stream may be one that shows the scene only together with others
   */
  static async create(code, store, options = {}) {
    const instance = code instanceof WebAssembly.Module ? await instantiate(code) : code;
    const stream = nextStream++;
    stores.set(stream, store);
    const decoder = new Decoder(instance, store, stream);
    decoder.handle = decoder.wasm.l4dw_create(stream, options.maxMemoryBytes ?? 1.5 * 2 ** 30,
                                              options.cacheBytes ?? 64 * 2 ** 20,
                                              options.tolerant === false ? 0 : 1, options.acceptNeeds ? 1 : 0);
    if (!decoder.handle) throw new L4DError('OUT_OF_MEMORY', 'no memory for a decoder');
    return decoder;
  }

  dispose() {
    if (this.handle) this.wasm.l4dw_destroy(this.handle);
    this.handle = 0;
    stores.delete(this.stream);
  }

  get memoryBytes() { return this.wasm.memory.buffer.byteLength; }

  /** @param {number} at */
  #text(at) {
    const bytes = new Uint8Array(this.wasm.memory.buffer, at);
    return new TextDecoder().decode(bytes.slice(0, bytes.indexOf(0)));
  }

  /** The list that the last call made. */
  #numbers() {
    return [...new Float64Array(this.wasm.memory.buffer, this.wasm.l4dw_numbers(this.handle),
                                this.wasm.l4dw_num_numbers(this.handle))];
  }

  /**
   * Calls l4dw_NAME. Undefined: bytes lack.
   * @param {string} name @param {...number} args @returns {number[] | undefined}
   */
  #call(name, ...args) {
    this.store.misses.length = 0;
    const status = this.wasm[`l4dw_${name}`](this.handle, ...args);
    // A tolerant decoder goes on without what it cannot read: the reader fetches that all the same.
    if (this.store.misses.length > 0) return undefined;
    if (status !== 0) {
      throw L4DError.fromStatus(this.#text(this.wasm.l4dw_status_name(status)),
                                this.#text(this.wasm.l4dw_error(this.handle)));
    }
    return this.#numbers();
  }

  /** @param {number} at @param {number} length */
  #floats(at, length) { return new Float32Array(this.wasm.memory.buffer, at, length); }

  /** @returns {true | undefined} */
  open() { return this.#call('open', this.store.size) && true; }

  /** @returns {Info} */
  info() {
    const numbers = this.#call('info') ?? [];
    const info = Object.fromEntries(infoFields.map((name, k) => [name, numbers[k]]));
    return /** @type {any} */ ({...info, frameRate: info.rateNumerator / info.rateDenominator, ...this.#statements()});
  }

  /** @returns {{rendering: Rendering, presentation: Presentation}} */
  #statements() {
    const n = this.#call('statements') ?? [];
    const vector = (/** @type {number} */ k) => /** @type {Vector} */ (n.slice(k, k + 3));
    const [dilation, cutoff, minAlpha, maxAlpha, compensation, playback, metresPerUnit, hasBounds] = n;
    return {
      rendering: {dilation, cutoff, minAlpha, maxAlpha, compensation: compensation === 1},
      presentation: {
        playback: playbacks[playback] ?? null,
        bounds: hasBounds ? {min: vector(8), max: vector(11)} : null,
        camera: n[14] ? {position: vector(15), target: vector(18), up: vector(21), fov: n[24]} : null,
        metresPerUnit: metresPerUnit || null
      }
    };
  }

  /**
   * The buckets that show any instant of [begin, end].
   * @param {number} begin @param {number} end @param {Part} [part] @returns {Bucket[] | undefined}
   */
  buckets(begin, end, {maxLevel = all, maxTier = all} = {}) {
    const n = this.#call('buckets', begin, end, maxLevel, maxTier);
    return n && Array.from({length: n.length / 6}, (_, k) => {
      const [layer, bucket, count, center, width, level] = n.slice(6 * k, 6 * k + 6);
      return {layer, bucket, count, center, width, level};
    });
  }

  /**
   * The ranges of bytes that buckets() reads, and with steps.all the pages too.
   * @param {number} begin @param {number} end @param {Part} part @param {number} step
   * @returns {[number, number][] | undefined}
   */
  windowReads(begin, end, {maxLevel = all, maxTier = all, detail = details.full}, step) {
    return this.#ranges(this.#call('window_reads', begin, end, maxLevel, maxTier, detail, step));
  }

  /**
   * @param {Bucket[]} buckets @param {number} detail @param {number} step
   * @returns {[number, number][] | undefined}
   */
  bucketReads(buckets, detail, step) {
    const sorted = [...buckets].sort((a, b) => a.layer - b.layer || a.bucket - b.bucket);
    const at = this.wasm.malloc(8 * Math.max(sorted.length, 1));
    if (!at) throw new L4DError('OUT_OF_MEMORY', 'no memory for a list of buckets');
    new Uint32Array(this.wasm.memory.buffer, at, 2 * sorted.length)
      .set(sorted.flatMap(b => [b.layer, b.bucket]));
    try {
      return this.#ranges(this.#call('bucket_reads', at, sorted.length, detail, step));
    } finally {
      this.wasm.free(at);
    }
  }

  /** @param {number[] | undefined} n @returns {[number, number][] | undefined} */
  #ranges(n) {
    return n && Array.from({length: n.length / 2}, (_, k) => [n[2 * k], n[2 * k + 1]]);
  }

  /** @param {number} layer @param {number} bucket @param {number} detail @returns {Rows | undefined} */
  rows(layer, bucket, detail) {
    const n = this.#call('rows', layer, bucket, detail);
    if (!n) return undefined;
    const [count, shStride, center, geometry, sh] = n;
    const rows = {
      count, shStride, center,
      geometry: this.#floats(geometry, 16 * count).slice(),
      sh: new Uint16Array(this.wasm.memory.buffer, sh, shStride * count).slice()
    };
    this.wasm.l4dw_release(this.handle);
    return rows;
  }

  /**
   * The 3D Gaussians of an instant.
   * @param {number} time @param {{sh?: boolean, detail?: number, maxTier?: number}} [options]
   * @returns {import('./movie.js').Slice | undefined}
   */
  slice(time, {sh = true, detail = details.full, maxTier = all} = {}) {
    const n = this.#call('slice', time, maxTier, detail, sh ? 1 : 0);
    if (!n) return undefined;
    const [count, position, covariance, opacity, coefficients] = n;
    const {shDegree} = this.info();
    const terms = 3 * (shDegree + 1) ** 2;
    const out = {
      count, shDegree,
      position: this.#floats(position, 3 * count).slice(),
      covariance: this.#floats(covariance, 6 * count).slice(),
      opacity: this.#floats(opacity, count).slice(),
      sh: sh ? this.#floats(coefficients, terms * count).slice() : null
    };
    this.wasm.l4dw_release(this.handle);
    return out;
  }

  /**
   * Attributes as the stream has them, of everything or of [begin, end]. `window` is there if the stream has flat
   * windows: [count, 2] frames, 0 0 where a Gaussian has none.
   * @param {number} [begin] @param {number} [end] @param {number} [detail]
   * @returns {Record<string, Float32Array | Uint32Array> | undefined}
   */
  decode(begin = 1, end = 0, detail = details.full) {
    const n = this.#call('decode', begin, end, detail);
    if (!n) return undefined;
    const terms = 3 * (this.info().shDegree + 1) ** 2;
    const names = ['position', 'mean_t', 'mean_t_local', 'log_scale', 'rotor', 'opacity', 'sh'];
    const widths = [3, 1, 1, 4, 8, 1, terms];
    /** @type {Record<string, Float32Array | Uint32Array>} */
    const out = Object.fromEntries(names.map((name, k) =>
      [name, this.#floats(n[k + 1], n[0] * widths[k]).slice()]));
    const [hasWindows, windows] = n.slice(1 + names.length);
    if (hasWindows) out.window = new Uint32Array(this.wasm.memory.buffer, windows, 2 * n[0]).slice();
    this.wasm.l4dw_release(this.handle);
    return out;
  }

  /** Begins to measure a link, for a ladder of so many rungs (include/l4d/rate.h). @param {number} rungs */
  beginRate(rungs) { this.#call('rate_begin', rungs); }

  /**
   * A request was sent, its first and its last byte arrived, in seconds; in the order in which they end.
   * @param {number} sent @param {number} first @param {number} last @param {number} bytes
   */
  addTransfer(sent, first, last, bytes) { this.#call('rate_add', sent, first, last, bytes); }

  /**
   * Which rung to fetch, and with what the link has left.
   * @param {{buffered: number, missing: number}[]} states of all rungs, seconds and bytes
   */
  chooseRung(states) {
    const at = this.wasm.malloc(16 * states.length);
    if (!at) throw new L4DError('OUT_OF_MEMORY', 'no memory for a list of rungs');
    new Float64Array(this.wasm.memory.buffer, at, 2 * states.length).set(states.flatMap(s => [s.buffered, s.missing]));
    try {
      const [rung, fillRung, cancel, mergeGap, maxRangeBytes, throughput, roundTrip] =
        this.#call('rate_choose', at, states.length) ?? [];
      return {rung, fillRung, cancel, mergeGap, maxRangeBytes, throughput, roundTrip};
    } finally {
      this.wasm.free(at);
    }
  }

  /** What the last call has lost. */
  losses() {
    const n = this.#call('losses') ?? [];
    return Array.from({length: n.length / 7}, (_, k) => {
      const [status, layer, bucket, gaussians, offset, clause, detailOnly] = n.slice(7 * k, 7 * k + 7);
      return {
        code: this.#text(this.wasm.l4dw_status_name(status)).replace(/^L4D_ERR_/, ''),
        layer, bucket, gaussians, offset, clause: this.#text(clause), detailOnly: detailOnly === 1
      };
    });
  }
}
