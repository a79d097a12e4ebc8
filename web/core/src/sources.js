// SPDX-License-Identifier: Apache-2.0
// Where bytes come from. A source has open(signal), which returns the size, and
// read(offset, size, signal, onBytes, onStart), which calls onBytes(offset, bytes) as they arrive and, over a network,
// onStart() when the answer begins.
import {abortError, fetchError, L4DError, statusError} from './errors.js';

/** @typedef {(offset: number, bytes: Uint8Array) => void} OnBytes */

export class BufferSource {
  /** @param {ArrayBuffer} buffer */
  constructor(buffer) { this.bytes = new Uint8Array(buffer); }
  isLocal = true;
  async open() { return this.bytes.length; }
  /** @param {number} offset @param {number} size @param {AbortSignal} _signal @param {OnBytes} onBytes */
  async read(offset, size, _signal, onBytes) {
    onBytes(offset, this.bytes.subarray(offset, offset + size));
  }
}

export class BlobSource {
  /** @param {Blob} blob */
  constructor(blob) { this.blob = blob; }
  isLocal = true;
  async open() { return this.blob.size; }
  /** @param {number} offset @param {number} size @param {AbortSignal} signal @param {OnBytes} onBytes */
  async read(offset, size, signal, onBytes) {
    const buffer = await this.blob.slice(offset, offset + size).arrayBuffer();
    if (signal.aborted) throw abortError();
    onBytes(offset, new Uint8Array(buffer));
  }
}

const firstBytes = 65536;
const retryDelays = [200, 800, 2000];  // ms

/** Waits, and fails as soon as the signal aborts. @param {number} ms @param {AbortSignal} signal */
const wait = (ms, signal) => new Promise((resolve, reject) => {
  const timer = setTimeout(resolve, ms);
  signal.addEventListener('abort', () => { clearTimeout(timer); reject(abortError()); }, {once: true});
});

/**
 * A file behind HTTP: ranges where the server knows them, else read from its beginning. Or a part of one, which may
 * grow behind it: then the server must know ranges, and its ETag says nothing of the part.
 */
export class HttpSource {
  /**
   * @param {string} url
   * @param {{headers?: Record<string, string>, credentials?: RequestCredentials, fetch?: typeof fetch,
   *   onRetry?: (message: string) => void, part?: {offset: number, bytes: number}}} [options]
   */
  constructor(url, options = {}) {
    this.url = url;
    this.options = options;
    this.part = options.part ?? null;
    this.fetch = options.fetch ?? globalThis.fetch.bind(globalThis);
    this.etag = '';
    this.size = 0;
    this.control = new AbortController();
    this.isWhole = false;  // the server ignores ranges
    this.arrived = 0;      // bytes, from the beginning, of a whole file
    this.requests = 0;
    /** @type {{offset: number, bytes: Uint8Array}[]} what open() has read already */
    this.early = [];
    /** @type {(() => void)[]} */
    this.waiting = [];
    /** @type {unknown} */
    this.failure = null;
    /** @type {ReadableStream<Uint8Array> | null} */
    this.body = null;
  }
  isLocal = false;

  /** @param {AbortSignal} signal @returns {Promise<number>} */
  async open(signal) {
    // A whole file goes on coming after that.
    const abort = () => this.control.abort();
    signal.addEventListener('abort', abort, {once: true});
    try {
      return await (this.part ? this.#insist(() => this.#openPart(), signal) : this.#open());
    } finally {
      signal.removeEventListener('abort', abort);
    }
  }

  close() { this.control.abort(); }

  async #open() {
    const response = await this.#request(0, firstBytes, this.control.signal);
    this.etag = response.headers.get('ETag') ?? '';
    if (response.status === 206) {
      this.size = this.#total(response);
      this.early.push({offset: 0, bytes: new Uint8Array(await response.arrayBuffer())});
    } else {
      this.isWhole = true;
      const length = Number(response.headers.get('Content-Length') ?? 0);
      if (!(length > 0) || response.headers.get('Content-Encoding')) {
        // Its length shows at its end.
        const bytes = new Uint8Array(await response.arrayBuffer());
        this.size = this.arrived = bytes.length;
        this.early.push({offset: 0, bytes});
      } else {
        this.size = length;
        this.body = response.body;
      }
    }
    if (this.size === 0) throw new L4DError('TRUNCATED', `${this.url}: the file is empty`);
    return this.size;
  }

  /** How long the file is of which a part has come. @param {Response} response */
  #total(response) {
    const range = response.headers.get('Content-Range');
    if (range === null && response.type === 'cors') {
      throw new L4DError('CORS', `${this.url}: the server hides from pages of other origins how long the file is; ` +
        'it must send "Access-Control-Expose-Headers: Content-Range, ETag"');
    }
    const total = /\/(\d+)$/.exec(range ?? '')?.[1];
    if (total === undefined) {
      throw new L4DError('NO_RANGES', `${this.url}: the server sends a part of the file and does not say how long the file is ` +
        `(Content-Range: ${range ?? 'none'}); it must say so, or know no ranges and send all of the file`);
    }
    return Number(total);
  }

  async #openPart() {
    const {bytes} = /** @type {{bytes: number}} */ (this.part);
    const wanted = Math.min(firstBytes, bytes);
    const response = await this.#request(0, wanted, this.control.signal);
    const early = new Uint8Array(await response.arrayBuffer());
    if (early.length < wanted) throw new L4DError('TRUNCATED', `${this.url}: the file ends before the part`);
    this.size = bytes;
    this.early = [{offset: 0, bytes: early}];
    return bytes;
  }

  /** Hands out what open() has read; of a whole file, the rest as it comes. @param {OnBytes} onBytes */
  begin(onBytes) {
    for (const {offset, bytes} of this.early) onBytes(offset, bytes);
    this.early = [];
    if (this.body) this.#readWhole(this.body, onBytes);
  }

  /**
   * @param {number} offset @param {number} size @param {AbortSignal} signal @param {OnBytes} onBytes
   * @param {() => void} [onStart]
   */
  async read(offset, size, signal, onBytes, onStart = () => {}) {
    if (this.isWhole) return this.#awaitWhole(offset + size, signal);
    return this.#insist(() => this.#readRange(offset, size, signal, onBytes, onStart), signal);
  }

  /** Tries again where the network fails. @template T @param {() => Promise<T>} fn @param {AbortSignal} signal */
  async #insist(fn, signal) {
    for (let attempt = 0; ; ++attempt) {
      try {
        return await fn();
      } catch (error) {
        const failure = /** @type {any} */ (error);
        if (failure?.name === 'AbortError') throw error;
        const again = !(failure instanceof L4DError) || failure.code === 'NETWORK';
        if (!again || attempt >= retryDelays.length) {
          throw failure instanceof L4DError ? failure :
            new L4DError('NETWORK', `${this.url}: ${failure?.message ?? failure}`);
        }
        this.options.onRetry?.(String(failure?.message ?? failure));
        await wait(retryDelays[attempt], signal);
      }
    }
  }

  /** @param {number} offset @param {number} size @param {AbortSignal} signal */
  async #request(offset, size, signal) {
    ++this.requests;
    const begin = offset + (this.part?.offset ?? 0);
    /** @type {Record<string, string>} */
    const headers = {...this.options.headers, Range: `bytes=${begin}-${begin + size - 1}`};
    // Weak ones do not vouch for bytes.
    if (this.etag && !this.etag.startsWith('W/')) headers['If-Range'] = this.etag;
    let response;
    try {
      response = await this.fetch(this.url, {headers, signal, credentials: this.options.credentials,
                                             cache: 'no-store'});
    } catch (error) {
      if (/** @type {any} */ (error)?.name === 'AbortError') throw error;
      throw fetchError(this.url, error);
    }
    if (response.status === 416) {
      throw new L4DError(this.etag ? 'CHANGED' : 'TRUNCATED', this.etag ?
        `${this.url}: the file has become shorter` : `${this.url}: the file ends before byte ${begin}`);
    }
    if (response.status !== 206 && response.status !== 200) throw statusError(this.url, response.status);
    if (this.part && response.status === 200) {
      void response.body?.cancel();
      throw new L4DError('NO_RANGES', `${this.url}: the server does not know ranges of bytes, which files of several streams ` +
        'need; put the file on one that does (all common ones do)');
    }
    return response;
  }

  /**
   * @param {number} offset @param {number} size @param {AbortSignal} signal @param {OnBytes} onBytes
   * @param {() => void} onStart
   */
  async #readRange(offset, size, signal, onBytes, onStart) {
    const response = await this.#request(offset, size, signal);
    onStart();
    const etag = response.headers.get('ETag') ?? '';
    if (this.etag && etag !== this.etag) {
      void response.body?.cancel();
      throw new L4DError('CHANGED', `${this.url}: the file is another one now`);
    }
    if (response.status === 200) {
      // The same file, and no ranges after all.
      onBytes(0, new Uint8Array(await response.arrayBuffer()));
      return;
    }
    await this.#eachPiece(/** @type {ReadableStream<Uint8Array>} */ (response.body), offset, onBytes, size);
  }

  /**
   * Whole blocks as they arrive.
   * @param {ReadableStream<Uint8Array>} body @param {number} offset @param {OnBytes} onBytes
   * @param {number} size what must come
   */
  async #eachPiece(body, offset, onBytes, size) {
    const reader = body.getReader();
    let rest = new Uint8Array(0);
    let got = 0;
    for (;;) {
      const {done, value} = await reader.read();
      if (value) {
        got += value.length;
        const joined = new Uint8Array(rest.length + value.length);
        joined.set(rest);
        joined.set(value, rest.length);
        rest = joined;
      }
      const whole = done ? rest.length : Math.floor((offset + rest.length) / 4096) * 4096 - offset;
      if (whole > 0) {
        onBytes(offset, rest.subarray(0, whole));
        offset += whole;
        rest = rest.slice(whole);
      }
      if (done) break;
    }
    if (got < size) throw new L4DError('NETWORK', `${this.url}: the answer ended early`);
  }

  /** @param {ReadableStream<Uint8Array>} body @param {OnBytes} onBytes */
  async #readWhole(body, onBytes) {
    try {
      await this.#eachPiece(body, 0, (offset, bytes) => {
        onBytes(offset, bytes);
        this.arrived = offset + bytes.length;
        for (const wake of this.waiting.splice(0)) wake();
      }, this.size);
    } catch (error) {
      this.failure = error instanceof L4DError ? error :
        new L4DError('NETWORK', `${this.url}: ${/** @type {any} */ (error)?.message ?? error}`);
    }
    for (const wake of this.waiting.splice(0)) wake();
  }

  /** @param {number} end @param {AbortSignal} signal */
  async #awaitWhole(end, signal) {
    while (this.arrived < Math.min(end, this.size)) {
      if (this.failure) throw this.failure;
      await new Promise((resolve, reject) => {
        this.waiting.push(() => resolve(undefined));
        signal.addEventListener('abort', () => reject(abortError()), {once: true});
      });
    }
  }
}
