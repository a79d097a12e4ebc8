// SPDX-License-Identifier: Apache-2.0
// How requests are sent: with what the page adds to them, to which of several servers, for how long, how often.
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
 * @property {number} [timeout] seconds without a byte, after which a request has failed (10)
 * @property {number} [retries] how often a request is sent again that has failed (3)
 * @property {string[]} [bases] addresses of folders with the same files: what fails at one is sent to the next
 * @property {(request: Request) => Promise<Request>} [request] is called before each request
 * @property {typeof fetch} [fetch] @property {(message: string) => void} [onRetry]
 */

const retryDelays = [200, 800, 2000];  // ms; the last one holds for those that follow

/** Waits, and fails as soon as the signal aborts. @param {number} ms @param {AbortSignal} signal */
const wait = (ms, signal) => new Promise((resolve, reject) => {
  const timer = setTimeout(resolve, ms);
  signal.addEventListener('abort', () => { clearTimeout(timer); reject(abortError()); }, {once: true});
});

/** An answer that has begun. */
export class Answer {
  /** @param {Response} response @param {number} base that it is of @param {() => void} alive @param {() => void} end */
  constructor(response, base, alive, end) {
    this.response = response;
    this.base = base;
    this.alive = alive;
    this.end = end;
  }
  /** @param {string} name */
  header(name) { return this.response.headers.get(name); }

  /** @returns {AsyncGenerator<Uint8Array>} */
  async *pieces() {
    const reader = /** @type {ReadableStream<Uint8Array>} */ (this.response.body).getReader();
    try {
      for (;;) {
        const {done, value} = await reader.read();
        this.alive();
        if (value) yield value;
        if (done) return;
      }
    } finally {
      this.end();
      void reader.cancel().catch(() => {});
    }
  }

  async bytes() {
    const pieces = [];
    for await (const piece of this.pieces()) pieces.push(piece);
    return new Uint8Array(await new Blob(/** @type {BlobPart[]} */ (pieces)).arrayBuffer());
  }

  cancel() {
    this.end();
    void this.response.body?.cancel().catch(() => {});
  }

  /** Of the file, as far as the server lets a page see it: weak and strong tags of a version are the same to us. */
  get version() { return {tag: (this.header('ETag') ?? '').replace(/^W\//, ''), modified: this.header('Last-Modified') ?? ''}; }
}

/** @typedef {{tag: string, modified: string}} Version */
/** @param {Version} a @param {Version} b */
export const differ = (a, b) => a.tag && b.tag ? a.tag !== b.tag : Boolean(a.modified && b.modified) && a.modified !== b.modified;

export class Link {
  /** @param {string} url of what is opened @param {LinkOptions} [options] */
  constructor(url, options = {}) {
    this.options = options;
    this.fetch = options.fetch ?? globalThis.fetch.bind(globalThis);
    this.bases = options.bases ?? [];
    /** Others may be named by a playlist, which what is in headers is not meant for. */
    this.origins = new Set([url, ...this.bases].map(address => new URL(address).origin));
    this.base = 0;  // the one that has answered last
    /** @type {Set<string>} what is being fetched through the cache of the browser */
    this.cached = new Set();
  }

  get cache() { return this.options.cache ?? 'default'; }
  /** Of the first request of a file: what a cache has is good if the server says so. @type {RequestCache} */
  get revalidated() { return this.cache === 'default' ? 'no-cache' : this.cache; }

  /** The address at the base of now. @param {string} url */
  #placed(url) {
    const base = this.bases.find(b => url.startsWith(b));
    return base ? this.bases[this.base] + url.slice(base.length) : url;
  }

  /**
   * Sends one request. Fails where its status is none of 200, 206 and 416; also later, where nothing comes for too long.
   * @param {string} url @param {AbortSignal} signal @param {{range?: string, cache?: RequestCache}} [how]
   */
  async send(url, signal, {range, cache = this.cache} = {}) {
    // Chromium sends a second request of one address to the server, and again once it has waited for the first one in vain.
    const isCached = cache === 'default' && !this.cached.has(url);
    if (isCached) this.cached.add(url);
    const mode = isCached || cache !== 'default' ? cache : 'no-store';
    const {base} = this;
    const {timeout = 10, credentials = 'same-origin'} = this.options;
    let request = {url: this.#placed(url), headers: {}, credentials};
    if (this.origins.has(new URL(request.url).origin)) request.headers = {...this.options.headers};
    const control = new AbortController();
    /** @type {any} */
    let timer;
    const abort = () => control.abort(abortError());
    const alive = () => {
      clearTimeout(timer);
      timer = setTimeout(() => control.abort(new L4DError('NETWORK', `${url}: nothing came for ${timeout} s`)), 1000 * timeout);
    };
    const end = () => {
      clearTimeout(timer);
      signal.removeEventListener('abort', abort);
      if (isCached) this.cached.delete(url);
    };
    signal.addEventListener('abort', abort);
    if (signal.aborted) abort();
    try {
      if (this.options.request) request = await this.options.request(request);
      alive();
      const headers = range ? {...request.headers, Range: range} : request.headers;
      const response = await this.fetch(request.url, {headers, signal: control.signal, credentials: request.credentials, cache: mode});
      const answer = new Answer(response, base, alive, end);
      if ([200, 206, 416].includes(response.status)) return answer;
      answer.cancel();
      throw statusError(request.url, response.status);
    } catch (error) {
      end();
      const failure = /** @type {any} */ (error);
      if (failure instanceof L4DError || failure?.name === 'AbortError') throw error;
      throw fetchError(request.url, error, Object.keys(request.headers));
    }
  }

  /**
   * Calls fn again where the network fails, each time with the next base. `refusals`: how often in a row the browser had no
   * answer, or none that it takes.
   * @template T @param {(refusals: number) => Promise<T>} fn @param {AbortSignal} signal
   */
  async insist(fn, signal) {
    const {retries = 3} = this.options;
    for (let attempt = 0, refusals = 0; ; ++attempt) {
      try {
        return await fn(refusals);
      } catch (error) {
        const failure = /** @type {any} */ (error);
        if (failure?.name === 'AbortError') throw error;
        refusals = failure?.cause instanceof TypeError ? refusals + 1 : 0;
        const isNetwork = !(failure instanceof L4DError) || failure.code === 'NETWORK';
        const elsewhere = attempt + 1 < this.bases.length;
        if (!elsewhere && (!isNetwork || attempt >= retries)) {
          throw failure instanceof L4DError ? failure : new L4DError('NETWORK', String(failure?.message ?? failure));
        }
        if (this.bases.length > 0) this.base = (this.base + 1) % this.bases.length;
        this.options.onRetry?.(String(failure?.message ?? failure));
        if (!elsewhere) await wait(retryDelays[Math.min(attempt, retryDelays.length - 1)], signal);
      }
    }
  }
}
