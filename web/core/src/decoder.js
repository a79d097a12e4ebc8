// SPDX-License-Identifier: Apache-2.0
// l4d.wasm (web/wasm/bridge.cc): the engine of playback and the decoders of its streams.
import {L4DError, statusError} from './errors.js';

export const infoFields = /** @type {const} */ ([
  'formatMajor', 'formatMinor', 'shDegree', 'tools', 'numLayers', 'numGaussians', 'fileBytes', 'timeBegin',
  'numFrames', 'rateNumerator', 'rateDenominator', 'duration', 'coordinateSystem', 'colorSpace', 'profile', 'level'
]);
const stateFields = /** @type {const} */ ([
  'stream', 'motion', 'cause', 'rung', 'numRungs', 'ready', 'begin', 'end', 'time', 'at', 'velocity', 'from', 'until', 'wakeAt',
  'throughput', 'bytes', 'requests', 'live', 'liveDistance', 'shDegree'
]);
const itemFields = /** @type {const} */ ([
  'kind', 'id', 'source', 'flags', 'offset', 'size', 'stream', 'layer', 'bucket', 'detail', 'units', 'event', 'cause', 'time', 'value'
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
 *   {frameRate: number, lastTier: number, tiers: number[], rendering: Rendering, presentation: Presentation}} Info
 */
const playbacks = /** @type {const} */ ([null, 'once', 'loop', 'ping-pong']);
/** @typedef {{layer: number, bucket: number, count: number, center: number}} Bucket count: Gaussians at most; center: seconds */
/** @typedef {{[K in typeof stateFields[number]]: number}} State of l4d_playback_state; at: anchor_now, time: anchor_time */
/** @typedef {{[K in typeof itemFields[number]]: number}} Item of l4d_playback_item */
/** @typedef {{stream: number, isStanding: boolean, begin: number, end: number, shift: number}} Shown of l4d_shown_member */
/**
 * @typedef {object} Rows what of a bucket does not change with time (web/wasm/rows.h)
 * @property {number} count
 * @property {number} shStride binary16 numbers from one row to the next
 * @property {number} center seconds; times of rows are relative to it
 * @property {Float32Array} geometry [count, 16]; a negative last number of a row: a flat window (timeline.js)
 * @property {Uint16Array} sh [count, shStride]
 */

export const details = {full: 0, base: 1};
export const all = 0xffffffff;

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

/** @param {WebAssembly.Module} module */
const instantiate = async module => {
  const instance = await WebAssembly.instantiate(module, {
    env: {emscripten_notify_memory_growth() {}},
    wasi_snapshot_preview1: {
      proc_exit(/** @type {number} */ code) { throw new L4DError('INTERNAL', `the decoder ended (${code})`); },
      fd_close: () => 0
    }
  });
  /** @type {any} */ (instance.exports)._initialize?.();
  return instance;
};

/** @param {Float64Array} numbers @param {readonly string[]} names @param {number} at @returns {any} */
const named = (numbers, names, at) => Object.fromEntries(names.map((name, k) => [name, numbers[at + k]]));

export class Decoder {
  /** @param {WebAssembly.Instance} instance */
  constructor(instance) {
    this.instance = instance;
    this.wasm = /** @type {any} */ (instance.exports);
    this.handle = 0;
  }

  /**
   * @param {WebAssembly.Module | WebAssembly.Instance} code instances share their memory
   * @param {{maxMemoryBytes?: number, cacheBytes?: number, maxRows?: number, ahead?: number, timeout?: number, failures?: number,
   *   tolerant?: boolean, slices?: boolean, live?: import('./movie.js').LiveOptions}} [options] slices: it is for slice() alone, else
   *   for rows()
   */
  static async create(code, {maxMemoryBytes = 1.5 * 2 ** 30, cacheBytes = 256 * 2 ** 20, maxRows = 2 ** 21, ahead = 6, timeout = 10,
                             failures = 4, tolerant = true, slices = false, live = {}} = {}) {
    const instance = code instanceof WebAssembly.Module ? await instantiate(code) : code;
    const decoder = new Decoder(instance);
    // What is kept is in blocks of a megabyte.
    decoder.handle = decoder.wasm.l4dw_create(maxMemoryBytes, Math.max(cacheBytes, 2 ** 20), maxRows, ahead, timeout, failures,
                                              tolerant ? 0 : 1, slices ? 1 : 0, live.distance ?? 0, live.slowest ?? 0, live.fastest ?? 0,
                                              live.staleAfter ?? 0);
    if (!decoder.handle) throw new L4DError('OUT_OF_MEMORY', 'no memory for a decoder');
    return decoder;
  }

  dispose() {
    if (this.handle) this.wasm.l4dw_destroy(this.handle);
    this.handle = 0;
  }

  get memoryBytes() { return this.wasm.memory.buffer.byteLength; }

  /** @param {number} at */
  #text(at) {
    const bytes = new Uint8Array(this.wasm.memory.buffer, at);
    return new TextDecoder().decode(bytes.slice(0, bytes.indexOf(0)));
  }

  /** The list that the last call made. */
  #numbers() {
    return new Float64Array(this.wasm.memory.buffer, this.wasm.l4dw_numbers(this.handle), this.wasm.l4dw_num_numbers(this.handle));
  }

  /** Of the status of a call. @param {number} status */
  errorOf(status) { return Object.assign(L4DError.fromStatus(this.#text(this.wasm.l4dw_status_name(status)), this.#text(this.wasm.l4dw_error())), {status}); }

  /** Calls l4dw_NAME. @param {string} name @param {...number} args @returns {Float64Array} good until the next call */
  call(name, ...args) {
    const status = this.wasm[`l4dw_${name}`](this.handle, ...args);
    if (status !== 0) throw this.errorOf(status);
    return this.#numbers();
  }

  /** Where what a call takes lies. @param {Uint8Array} bytes */
  #put(bytes) {
    const at = this.wasm.l4dw_input(this.handle, bytes.length);
    if (!at) throw new L4DError('OUT_OF_MEMORY', 'no memory for bytes that came');
    new Uint8Array(this.wasm.memory.buffer, at, bytes.length).set(bytes);
  }

  // ---- the engine: include/l4d/playback.h. Times are seconds.

  /** @param {number} now @param {string} uri @param {boolean} isPlaylist of several streams */
  open(now, uri, isPlaylist) {
    this.#put(new TextEncoder().encode(`${uri}\0`));
    this.call('open', now, isPlaylist ? 1 : 0);
  }

  /** @param {number} now @param {number} id of the request @param {Uint8Array} bytes */
  received(now, id, bytes) {
    this.#put(bytes);
    this.call('received', now, id, bytes.length);
  }

  /** What is to be done; there may be more. @param {number} now @returns {{state: State, items: Item[]}} */
  update(now) {
    const numbers = this.call('update', now);
    const items = [];
    for (let at = stateFields.length; at < numbers.length; at += itemFields.length) items.push(named(numbers, itemFields, at));
    return {state: named(numbers, stateFields, 0), items};
  }

  /** @param {number} source */
  uri(source) { return this.#text(this.wasm.l4dw_uri(this.handle, source)); }

  /** What can be shown without another byte, near the instant. @returns {[number, number][]} */
  buffered() {
    const n = this.call('buffered');
    return Array.from({length: n.length / 2}, (_, k) => [n[2 * k], n[2 * k + 1]]);
  }

  /** Streams and when they are shown: a media member, and after it what it needs. @returns {Shown[]} */
  shown() {
    const n = this.call('shown').slice();
    return Array.from({length: n.length / 5}, (_, k) => {
      const [stream, standing, begin, end, shift] = n.subarray(5 * k, 5 * k + 5);
      return {stream, isStanding: standing === 1, begin, end, shift};
    });
  }

  /**
   * The 3D Gaussians of an instant that is ready, of all streams that are shown.
   * @param {number} time @param {boolean} sh @returns {import('./movie.js').Slice}
   */
  slice(time, sh) {
    const [count, shDegree, position, covariance, opacity, coefficients] = this.call('slice', time, sh ? 1 : 0);
    const slice = {
      count, shDegree, position: this.#floats(position, 3 * count), covariance: this.#floats(covariance, 6 * count),
      opacity: this.#floats(opacity, count), sh: sh ? this.#floats(coefficients, 3 * (shDegree + 1) ** 2 * count) : null
    };
    this.wasm.l4dw_release(this.handle);
    return slice;
  }

  // ---- streams

  /** The stream that the calls below are of. @param {number} stream */
  select(stream) { this.call('select', stream); }

  /** @param {number} at @param {number} length */
  #floats(at, length) { return new Float32Array(this.wasm.memory.buffer, at, length).slice(); }

  /** @returns {Info} */
  info() {
    const numbers = this.call('info');
    const info = named(numbers, infoFields, 0);
    const tiers = [...new Set(numbers.subarray(infoFields.length))].sort((a, b) => a - b);
    return {...info, tiers, lastTier: tiers.at(-1) ?? 0, frameRate: info.rateNumerator / info.rateDenominator, ...this.#statements()};
  }

  /** @returns {{rendering: Rendering, presentation: Presentation}} */
  #statements() {
    const n = this.call('statements').slice();
    const vector = (/** @type {number} */ k) => /** @type {Vector} */ ([...n.subarray(k, k + 3)]);
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
   * @param {number} layer @param {number} bucket @param {number} detail
   * @param {number} [shDegree] of the rows, if that is more than the stream has @returns {Rows}
   */
  rows(layer, bucket, detail, shDegree = 0) {
    const [count, shStride, center, geometry, sh] = this.call('rows', layer, bucket, detail, shDegree);
    const rows = {
      count, shStride, center, geometry: this.#floats(geometry, 16 * count),
      sh: new Uint16Array(this.wasm.memory.buffer, sh, shStride * count).slice()
    };
    this.wasm.l4dw_release(this.handle);
    return rows;
  }

  /**
   * Attributes as the stream has them, of everything or of [begin, end]. `window` is there if the stream has flat
   * windows: [count, 2] frames, 0 0 where a Gaussian has none.
   * @param {number} [begin] @param {number} [end] @param {number} [detail]
   * @returns {Record<string, Float32Array | Uint32Array>}
   */
  decode(begin = 1, end = 0, detail = details.full) {
    const terms = 3 * (this.info().shDegree + 1) ** 2;
    const n = this.call('decode', begin, end, detail);
    const names = ['position', 'mean_t', 'mean_t_local', 'log_scale', 'rotor', 'opacity', 'sh'];
    const widths = [3, 1, 1, 4, 8, 1, terms];
    /** @type {Record<string, Float32Array | Uint32Array>} */
    const out = Object.fromEntries(names.map((name, k) => [name, this.#floats(n[k + 1], n[0] * widths[k])]));
    const [hasWindows, windows] = n.subarray(1 + names.length);
    if (hasWindows) out.window = new Uint32Array(this.wasm.memory.buffer, windows, 2 * n[0]).slice();
    this.wasm.l4dw_release(this.handle);
    return out;
  }

  /** What the last call of a stream has lost. */
  losses() {
    const n = this.call('losses').slice();
    return Array.from({length: n.length / 7}, (_, k) => {
      const [status, layer, bucket, gaussians, offset, clause, detailOnly] = n.subarray(7 * k, 7 * k + 7);
      return {
        code: this.#text(this.wasm.l4dw_status_name(status)).replace(/^L4D_ERR_/, ''),
        layer, bucket, gaussians, offset, clause: this.#text(clause), detailOnly: detailOnly === 1
      };
    });
  }
}
