// SPDX-License-Identifier: Apache-2.0
// Where bytes come from. A source has open(signal), which returns the size, and
// read(offset, size, signal, onBytes, onStart), which calls onBytes(offset, bytes) as they arrive and, over a network,
// onStart() when the answer begins.
import {abortError, L4DError} from './errors.js';
import {differ, Link} from './link.js';

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

/**
 * A file behind HTTP: ranges where the server knows them, else read from its beginning. Or a part of one, which may
 * grow behind it: then the server must know ranges, and its versions say nothing of the part.
 *
 * Requests have no header but Range, which pages may send to any origin without asking first. Neither ETag nor Content-Range
 * need be exposed to the page.
 */
export class HttpSource {
  /**
   * @param {string} url
   * @param {import('./link.js').LinkOptions & {link?: Link, part?: {offset: number, bytes: number}}} [options] link: of
   *   several files
   */
  constructor(url, {link, part, ...options} = {}) {
    this.url = url;
    this.link = link ?? new Link(url, options);
    this.part = part ?? null;
    /** By the server that it is on: each has versions of its own. @type {Map<number, import('./link.js').Version>} */
    this.versions = new Map();
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
    /** @type {import('./link.js').Answer | null} */
    this.body = null;
  }
  isLocal = false;

  /** @param {AbortSignal} signal @returns {Promise<number>} */
  async open(signal) {
    // A whole file goes on coming after that.
    const abort = () => this.control.abort();
    signal.addEventListener('abort', abort, {once: true});
    try {
      return await this.link.insist(refusals => this.part ? this.#openPart() : this.#open(refusals), signal);
    } finally {
      signal.removeEventListener('abort', abort);
    }
  }

  close() { this.control.abort(); }

  /** @param {number} refusals before */
  async #open(refusals) {
    if (refusals > 1) {
      // Browsers take no part of a file that is compressed on its way, but all of it.
      const answer = await this.#requestAll();
      if (answer.header('Content-Encoding') || !answer.header('Accept-Ranges')) return this.#openWhole(answer);
      answer.cancel();
    }
    const answer = await this.#request(0, firstBytes, this.control.signal, this.link.revalidated);
    this.versions = new Map([[answer.base, answer.version]]);
    const length = answer.response.status === 206 ? await this.#total(answer) : 0;
    if (length > 0) {
      this.size = length;
      this.early = [{offset: 0, bytes: await answer.bytes()}];
    } else if (answer.response.status === 206) {
      // A part of it, and no word of how much there is: then all of it.
      answer.cancel();
      await this.#openWhole(await this.#requestAll());
    } else {
      await this.#openWhole(answer);
    }
    return this.size;
  }

  #requestAll() {
    ++this.requests;
    return this.link.send(this.url, this.control.signal, {cache: this.link.revalidated});
  }

  /** @param {import('./link.js').Answer} answer with all of the file */
  async #openWhole(answer) {
    this.isWhole = true;
    const length = Number(answer.header('Content-Length') ?? 0);
    // Compressed on its way, or maybe, where a server of another origin hides that: its length shows at its end.
    if (!(length > 0) || answer.header('Content-Encoding') || answer.response.type === 'cors') {
      const bytes = await answer.bytes();
      this.size = this.arrived = bytes.length;
      this.early = [{offset: 0, bytes}];
    } else {
      this.size = length;
      this.body = answer;
    }
    if (this.size === 0) throw new L4DError('TRUNCATED', `${this.url}: the file is empty`);
    return this.size;
  }

  /** How long the file is of which a part comes; 0: the answer does not say it. @param {import('./link.js').Answer} answer */
  #stated(answer) { return Number(/\/(\d+)$/.exec(answer.header('Content-Range') ?? '')?.[1] ?? 0); }

  /** The same, by other means if need be. @param {import('./link.js').Answer} answer */
  async #total(answer) {
    if (answer.header('Content-Range') !== null) return this.#stated(answer);
    // Pages of other origins see Content-Length, always; of all of it, that is what is wanted.
    ++this.requests;
    const all = await this.link.send(this.url, this.control.signal, {range: 'bytes=0-'});
    all.cancel();
    return all.response.status === 206 ? Number(all.header('Content-Length') ?? 0) : 0;
  }

  async #openPart() {
    const {bytes} = /** @type {{bytes: number}} */ (this.part);
    const wanted = Math.min(firstBytes, bytes);
    const early = await (await this.#request(0, wanted, this.control.signal)).bytes();
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
    return this.link.insist(() => this.#readRange(offset, size, signal, onBytes, onStart), signal);
  }

  /** @param {number} offset @param {number} size @param {AbortSignal} signal @param {RequestCache} [cache] */
  async #request(offset, size, signal, cache) {
    ++this.requests;
    const begin = offset + (this.part?.offset ?? 0);
    const answer = await this.link.send(this.url, signal, {range: `bytes=${begin}-${begin + size - 1}`, cache});
    /** @type {(code: string, message: string) => never} */
    const refuse = (code, message) => {
      answer.cancel();
      throw new L4DError(code, `${this.url}: ${message}`);
    };
    const {status} = answer.response;
    if (status === 416 && this.size > 0 && !this.part) refuse('CHANGED', 'the file has become shorter');
    if (status === 416) refuse('TRUNCATED', `the file ends before byte ${begin}`);
    const range = status === 206 && answer.header('Content-Range');
    if (range && !range.startsWith(`bytes ${begin}-`)) refuse('NO_RANGES', `the server answers with ${range}, where byte ${begin} is wanted`);
    if (this.part && status === 200) {
      refuse('NO_RANGES', 'the server does not know ranges of bytes, which files of several streams need; put the file on one ' +
        'that does (all common ones do)');
    }
    return answer;
  }

  /** Whether what comes is of another file than what is here. @param {import('./link.js').Answer} answer */
  #isOther(answer) {
    if (this.part) return false;
    const total = answer.response.status === 206 ? this.#stated(answer) : 0;
    const known = this.versions.get(answer.base);
    if (!known) this.versions.set(answer.base, answer.version);
    return total > 0 && total !== this.size || known !== undefined && differ(known, answer.version);
  }

  /**
   * @param {number} offset @param {number} size @param {AbortSignal} signal @param {OnBytes} onBytes
   * @param {() => void} onStart
   */
  async #readRange(offset, size, signal, onBytes, onStart) {
    let answer = await this.#request(offset, size, signal);
    if (this.#isOther(answer)) {
      // A cache on the way may have an old one.
      answer.cancel();
      answer = await this.#request(offset, size, signal, 'reload');
    }
    if (this.#isOther(answer)) {
      answer.cancel();
      throw new L4DError('CHANGED', `${this.url}: the file is another one now`);
    }
    onStart();
    // The same file, and no ranges after all.
    if (answer.response.status === 200) onBytes(0, await answer.bytes());
    else await this.#eachPiece(answer, offset, onBytes, size);
  }

  /**
   * Whole blocks as they arrive.
   * @param {import('./link.js').Answer} answer @param {number} offset @param {OnBytes} onBytes
   * @param {number} size what must come
   */
  async #eachPiece(answer, offset, onBytes, size) {
    const end = offset + size;
    let rest = new Uint8Array(0);
    for await (const piece of answer.pieces()) {
      const joined = new Uint8Array(rest.length + piece.length);
      joined.set(rest);
      joined.set(piece, rest.length);
      const whole = Math.max(Math.floor((offset + joined.length) / 4096) * 4096 - offset, 0);
      if (whole > 0) onBytes(offset, joined.subarray(0, whole));
      offset += whole;
      rest = joined.slice(whole);
    }
    if (rest.length > 0) onBytes(offset, rest);
    if (offset + rest.length < end) throw new L4DError('NETWORK', `${this.url}: the answer ended early`);
  }

  /** @param {import('./link.js').Answer} answer @param {OnBytes} onBytes */
  async #readWhole(answer, onBytes) {
    try {
      await this.#eachPiece(answer, 0, (offset, bytes) => {
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
