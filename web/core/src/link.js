// SPDX-License-Identifier: Apache-2.0
// How requests of the engine are sent: with what the page adds to them, to which of several servers, past which caches. When one
// has failed, and what follows, the engine decides.
import {abortError, fetchError, L4DError, statusError} from './errors.js';

/**
 * @typedef {object} Request what a page may change of one
 * @property {string} url @property {Record<string, string>} headers besides Range @property {RequestCredentials} credentials
 */
/**
 * @typedef {object} LinkOptions
 * @property {Record<string, string>} [headers] of requests to the host of the file, and to those of `bases`
 * @property {RequestCredentials} [credentials]
 * @property {RequestCache} [cache] of the browser ('default'): 'no-store' passes it by
 * @property {string[]} [bases] addresses of folders with the same files: what fails at one is sent to the next
 * @property {(request: Request) => Promise<Request>} [request] is called before each request
 * @property {typeof fetch} [fetch]
 */
/**
 * @typedef {object} Ask what is wanted
 * @property {number} offset @property {number} size 0: up to the end @property {boolean} [isWhole] without a range
 * @property {boolean} [isFresh] past all caches @property {boolean} [isPlaylist]
 * @property {boolean} [isPart] the file may grow behind it
 */
/**
 * @typedef {object} Head of an answer: l4d_answer
 * @property {number} status @property {number} [offset] @property {number} [total] bytes @property {number} [version]
 * @property {number} [retryAfter] seconds
 */
/** @typedef {{url: string, signal: AbortSignal, isCached: boolean, base: number}} Sending isCached: through the cache of the browser; base: that was asked */
/** @typedef {{answered: (head: Head) => void, received: (bytes: Uint8Array) => void}} Sink */

/** A Blob or bytes, which answer at once. */
export class LocalLink {
  /** @param {Blob | ArrayBuffer} data */
  constructor(data) { this.data = data; }
  isLocal = true;
  /** @type {L4DError | null} */
  failure = null;

  /** @param {string} _uri @param {Ask} ask @param {AbortSignal} signal @param {Sink} sink */
  async send(_uri, {offset, size}, signal, sink) {
    const {data} = this;
    const total = data instanceof Blob ? data.size : data.byteLength;
    const end = size > 0 ? Math.min(offset + size, total) : total;
    if (offset >= total) return sink.answered({status: 416, total});
    const part = data.slice(offset, end);
    const bytes = new Uint8Array(part instanceof Blob ? await part.arrayBuffer() : part);
    if (signal.aborted) throw abortError();
    sink.answered({status: 206, offset, total});
    sink.received(bytes);
  }
}

/** @typedef {{tag: string, modified: string}} Version of a file; weak and strong tags of one are the same to us */
/** @param {Response} response @returns {Version} as far as the server lets a page see it */
const versionOf = ({headers}) => ({tag: (headers.get('ETag') ?? '').replace(/^W\//, ''), modified: headers.get('Last-Modified') ?? ''});
/** @param {Version} a @param {Version} b */
const differ = (a, b) => a.tag && b.tag ? a.tag !== b.tag : Boolean(a.modified && b.modified) && a.modified !== b.modified;

const good = [200, 206, 416];
const firstBytes = 65536;  // of the first request of the engine (decoder/playback/planner.cc)

export class Link {
  /** @param {string} url of what is opened @param {LinkOptions} [options] */
  constructor(url, options = {}) {
    this.options = options;
    this.fetch = options.fetch ?? globalThis.fetch.bind(globalThis);
    this.bases = options.bases ?? [];
    /** Others may be named by a playlist, which what is in headers is not meant for. */
    this.origins = new Set([url, ...this.bases].map(address => new URL(address).origin));
    this.base = 0;    // the one that has answered last
    this.home = url;  // what addresses are relative to: of a playlist, where it was found
    /** @type {Set<string>} what is being fetched through the cache of the browser */
    this.cached = new Set();
    /** What has answered. @type {Set<string>} */
    this.known = new Set();
    /** How often the browser had no answer, or none that it takes, of addresses that never answered. @type {Map<string, number>} */
    this.refusals = new Map();
    /** By the server and the address: each has versions of its own. @type {Map<string, Version[]>} */
    this.versions = new Map();
    /** Why the last request failed that did. @type {L4DError | null} */
    this.failure = null;
  }
  isLocal = false;

  /** The address at the base of now. @param {string} url */
  #placed(url) {
    const base = this.bases.find(b => url.startsWith(b));
    return base ? this.bases[this.base] + url.slice(base.length) : url;
  }

  /** One of several servers has failed: the next one is asked from now on. @param {Sending} sending */
  #turn({base}) {
    // Requests that fail there together turn once.
    if (this.bases.length > 0 && base === this.base) this.base = (this.base + 1) % this.bases.length;
  }

  /**
   * Sends a request. Resolves when its answer has ended; fails where it does not come, or breaks off.
   * @param {string} uri @param {Ask} ask @param {AbortSignal} signal @param {Sink} sink
   */
  async send(uri, ask, signal, sink) {
    const url = new URL(uri, this.home).href;
    /** @type {Sending} */
    const sending = {url, signal, isCached: false, base: this.base};
    try {
      for (let asked = 1; ; ++asked) {
        const response = await (asked === 1 && this.#takeEarly(ask, signal) || this.#answer(sending, ask));
        const {status} = response;
        if (good.includes(status)) return await this.#pass(sending, ask, response, sink);
        void response.body?.cancel().catch(() => {});
        this.failure = statusError(response.url || url, status);
        this.#turn(sending);
        if (asked < this.bases.length) continue;
        return sink.answered({status, retryAfter: Number(response.headers.get('Retry-After') ?? 0) || 0});
      }
    } catch (error) {
      const failure = /** @type {any} */ (error);
      if (signal.aborted || failure?.name === 'AbortError') throw error;
      this.#turn(sending);
      throw this.failure = failure instanceof L4DError ? failure : new L4DError('NETWORK', `${url}: ${failure?.message ?? failure}`);
    } finally {
      if (sending.isCached) this.cached.delete(url);
    }
  }

  /** Sends what the engine will ask for first, while it is not there yet. @param {boolean} isPlaylist @param {AbortSignal} signal */
  begin(isPlaylist, signal) {
    const ask = {offset: 0, size: isPlaylist ? 0 : firstBytes, isPlaylist};
    const control = new AbortController();
    const abort = () => control.abort();
    signal.addEventListener('abort', abort);
    this.early = {ask, abort, answer: this.#answer({url: this.home, signal: control.signal, isCached: false, base: this.base}, ask)};
    this.early.answer.catch(() => {});  // by who takes it
  }
  /** @type {{ask: Ask, abort: () => void, answer: Promise<Response>} | null} */
  early = null;

  /** @param {Ask} ask @param {AbortSignal} signal */
  #takeEarly({offset, size, isFresh, isPlaylist}, signal) {
    const {early} = this;
    this.early = null;
    if (isFresh || early?.ask.offset !== offset || !isPlaylist && early.ask.size !== size) return null;
    signal.addEventListener('abort', early.abort);
    return early.answer;
  }

  /** An answer that has begun, of the version that is known. @param {Sending} sending @param {Ask} ask */
  async #answer(sending, ask) {
    const {url} = sending;
    const {offset, size, isWhole, isFresh, isPlaylist, isPart} = ask;
    const range = isWhole || isPlaylist ? '' : `bytes=${offset}-${size > 0 ? offset + size - 1 : ''}`;
    // Browsers take no part of a file that is compressed on its way, but all of it.
    if (range && (this.refusals.get(url) ?? 0) > 1) {
      const response = await this.#fetch(sending, '', 'no-cache');
      if (response.status !== 200 || response.headers.get('Content-Encoding') || !response.headers.get('Accept-Ranges')) return response;
      void response.body?.cancel().catch(() => {});
    }
    const response = await this.#fetch(sending, range, this.#cacheOf(url, ask));
    const known = this.versions.get(`${sending.base} ${url}`)?.at(-1);
    // A cache on the way may have an old one.
    if (isFresh || isPlaylist || isPart || !good.includes(response.status) || !known || !differ(known, versionOf(response))) return response;
    void response.body?.cancel().catch(() => {});
    return this.#fetch(sending, range, 'reload');
  }

  /** How a request uses the cache of the browser. @param {string} url @param {Ask} ask @returns {RequestCache} */
  #cacheOf(url, {isFresh, isWhole, isPlaylist}) {
    const {cache = 'default'} = this.options;
    if (isFresh) return 'reload';
    if (cache !== 'default') return cache;
    // Of the first request of a file: what a cache has is good if the server says so.
    if (isPlaylist || isWhole || !this.known.has(url)) return 'no-cache';
    // Chromium sends a second request of one address to the server, and again once it has waited for the first one in vain.
    return this.cached.has(url) ? 'no-store' : 'default';
  }

  /** @param {Sending} sending @param {string} range @param {RequestCache} cache */
  async #fetch(sending, range, cache) {
    const {url, signal} = sending;
    sending.base = this.base;
    if (cache === 'default') this.cached.add(url);
    sending.isCached ||= cache === 'default';
    const {credentials = 'same-origin'} = this.options;
    let request = {url: this.#placed(url), headers: {}, credentials};
    if (this.origins.has(new URL(request.url).origin)) request.headers = {...this.options.headers};
    try {
      if (this.options.request) request = await this.options.request(request);
      const headers = range ? {...request.headers, Range: range} : request.headers;
      const response = await this.fetch(request.url, {headers, signal, credentials: request.credentials, cache});
      this.known.add(url);
      // All of it says nothing of parts.
      if (range) this.refusals.delete(url);
      return response;
    } catch (error) {
      const failure = /** @type {any} */ (error);
      if (failure instanceof L4DError || failure?.name === 'AbortError') throw error;
      if (!this.known.has(url)) this.refusals.set(url, (this.refusals.get(url) ?? 0) + 1);
      throw fetchError(request.url, error, Object.keys(request.headers));
    }
  }

  /** Counts the versions of a file, 0: it states none. @param {Sending} sending @param {Response} response */
  #numberOf({url, base}, response) {
    const version = versionOf(response);
    if (!version.tag && !version.modified) return 0;
    const key = `${base} ${url}`;
    const versions = this.versions.get(key) ?? [];
    if (!versions.some(v => !differ(v, version))) this.versions.set(key, [...versions, version]);
    return (this.versions.get(key) ?? []).findIndex(v => !differ(v, version)) + 1;
  }

  /**
   * Hands an answer over.
   * @param {Sending} sending @param {Ask} ask @param {Response} response @param {Sink} sink
   */
  async #pass(sending, {offset, isPlaylist}, response, sink) {
    const {url, signal} = sending;
    const {status, headers, type} = response;
    const range = headers.get('Content-Range') ?? '';
    let total = Number(/\/(\d+)$/.exec(range)?.[1] ?? 0), begin = 0;
    if (status === 206) begin = Number(/^bytes (\d+)-/.exec(range)?.[1] ?? offset);
    // Compressed on its way, or maybe, where a server of another origin hides that: its length shows at its end.
    else if (status === 200 && !headers.get('Content-Encoding') && type !== 'cors') total = Number(headers.get('Content-Length') ?? 0);
    if (status === 206 && begin !== offset) {
      this.failure = new L4DError('NO_RANGES', `${url}: the server answers with ${range}, where byte ${offset} is wanted`);
    }
    // Of another address after a redirection, which references are relative to.
    if (isPlaylist && response.redirected) this.home = response.url;
    sink.answered({status, offset: begin, total, version: this.#numberOf(sending, response)});
    const reader = /** @type {ReadableStream<Uint8Array>} */ (response.body)?.getReader();
    try {
      for (;;) {
        const {done, value} = await reader.read();
        if (signal.aborted) throw abortError();
        if (done) return;
        sink.received(value);
      }
    } finally {
      void reader.cancel().catch(() => {});
    }
  }
}
