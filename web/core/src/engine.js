// SPDX-License-Identifier: Apache-2.0
// The engine of playback in its worker: does what its items say, and tells the page what changes.
import {abortError, L4DError} from './errors.js';
import {all, Decoder, details} from './decoder.js';

/** Numbers of include/l4d/playback.h. */
const kinds = {request: 1, cancel: 2, load: 3, unload: 4, event: 5};
const flags = {fresh: 1, whole: 2, playlist: 8};
const events = {stream: 1, shown: 3, failed: 5, lost: 7, retry: 9, down: 10, up: 11, wrapped: 14, live: 15, jumped: 16, grown: 17, opened: 18, closed: 19};
const streams = {opening: 1, open: 2, degraded: 3, failed: 4};
const motions = {paused: 0, playing: 1, waiting: 2, ended: 3};
const commands = {play: 0, pause: 1, retry: 2, refresh: 3};
const network = {all: 0, instant: 1, metadata: 2};
const outcomes = {ended: 0, failed: 1, forbidden: 2};
/** By L4D_LIVE_*. */
const lives = ['', 'on-time', 'behind', 'stale', 'restarted', 'ended'];
/** By L4D_CAUSE_*. */
const causes = ['INTERNAL', 'NETWORK', 'NETWORK', 'HTTP', 'NOT_FOUND', 'CHANGED', 'CHECKSUM', 'CHECKSUM', 'TRUNCATED', 'CORRUPT', 'NOT_L4D',
                'VERSION_UNSUPPORTED', 'FEATURE_UNSUPPORTED', 'LIMIT_EXCEEDED', 'PLAYLIST', 'NO_RANGES'];
const linkCauses = 4;  // up to this one, the link knows why
/** @type {Record<string, string>} */
const reasons = {
  CHANGED: 'the file is another one now', CHECKSUM: 'bytes of the file are wrong', TRUNCATED: 'the file ends early',
  CORRUPT: 'the file breaks a rule of the format', NOT_L4D: 'this is no .l4d file', VERSION_UNSUPPORTED: 'the file is of a later version',
  FEATURE_UNSUPPORTED: 'the file uses what this version does not know', LIMIT_EXCEEDED: 'there is too little memory for it',
  PLAYLIST: 'the playlist breaks a rule, or lists nothing to show', NETWORK: 'the server does not answer',
  NO_RANGES: 'the server does not know ranges of bytes, which files of several streams need; put the file on one that does (all common ones do)'
};

/** Seconds of the clock that the page has, too. */
export const clock = () => (performance.timeOrigin + performance.now()) / 1000;
/** Views hold lines of 256. @param {number} rows */
const roundedRows = rows => Math.ceil(rows / 256) * 256;

/** @typedef {import('./decoder.js').Info & {maxRows: number}} MovieInfo */
/**
 * @typedef {object} Quality what is shown at most
 * @property {number} [maxLevel] @property {number} [maxTier] @property {number} [detail] details
 */

export class Engine {
  /**
   * @param {Decoder} decoder @param {import('./link.js').Link | import('./link.js').LocalLink} link
   * @param {string} url @param {(message: any, transfer?: Transferable[]) => void} post
   * @param {{isPlaylist?: boolean, maxRows?: number, tolerant?: boolean, preload?: string}} [options]
   */
  constructor(decoder, link, url, post, {isPlaylist = false, maxRows = 2 ** 21, tolerant = true, preload = 'auto'} = {}) {
    this.decoder = decoder;
    this.link = link;
    this.url = url;
    this.post = post;
    this.isPlaylist = isPlaylist;
    this.tolerant = tolerant;
    this.mostRows = maxRows;
    /** Whether pages are fetched: with preload 'metadata', once somebody seeks or plays. */
    this.isFetching = preload !== 'metadata';
    /** @type {Quality} */
    this.quality = {};
    /** @type {import('./decoder.js').State} */
    this.state = /** @type {any} */ ({stream: 0, motion: 0, ready: 0, live: 0});
    this.turn = 0;  // of the last command of the page
    /** @type {MovieInfo | null} */
    this.info = null;
    /** Requests under way. @type {Map<number, AbortController>} */
    this.requests = new Map();
    /** @type {import('./decoder.js').Item[]} */
    this.loads = [];
    /** Rows of the buckets that the page has. @type {Map<string, number>} */
    this.held = new Map();
    this.heldRows = 0;  // rounded
    /** What was held before `refresh`: views have it until it comes again, or is in the way. @type {Map<string, number>} */
    this.stale = new Map();
    this.staleRows = 0;  // rounded
    /** What cannot be shown, and the page knows of. @type {Set<string>} */
    this.lost = new Set();
    this.decodeSeconds = 0;
    this.lastProgress = 0;
    this.isDown = false;   // the server
    this.hasFailed = false;
    /** @type {Error | null} why it never plays again */
    this.over = null;
    this.told = '';
    this.lastSeek = 0;     // that was answered
    this.disposed = false;
    /** @type {{resolve: (info: any) => void, reject: (reason: any) => void} | null} */
    this.opening = null;
    /** Of slice(). @type {Map<number, {resolve: () => void, reject: (reason: any) => void}>} */
    this.seeks = new Map();
    const {port1, port2} = new MessageChannel();
    this.port = port1;
    port2.onmessage = () => {
      this.isCalled = false;
      if (!this.disposed) this.#step();
    };
    for (const port of [port1, port2]) /** @type {any} */ (port).unref?.();
    this.isCalled = false;
  }

  /** Opens what the link leads to. @param {AbortSignal} [signal] @returns {Promise<MovieInfo>} */
  open(signal) {
    signal?.addEventListener('abort', () => this.opening?.reject(abortError()), {once: true});
    return new Promise((resolve, reject) => {
      this.opening = {resolve, reject};
      this.decoder.open(clock(), this.url, this.isPlaylist);
      this.setQuality({});
      this.run();
    });
  }

  dispose() {
    this.disposed = true;
    clearTimeout(this.timer);
    this.port.close();
    for (const control of this.requests.values()) control.abort();
    this.opening?.reject(abortError());
    for (const {reject} of this.seeks.values()) reject(abortError());
    try {
      this.decoder.dispose();
    } catch {
      // It has ended by itself.
    }
  }

  // ---- commands

  /** @param {'play' | 'pause' | 'retry' | 'refresh'} name */
  command(name) {
    if (name === 'refresh') {
      this.loads = [];
      for (const [key, count] of this.held) this.stale.set(key, count);
      this.staleRows += this.heldRows;
      this.held.clear();
      this.heldRows = 0;
    }
    if (name === 'play') this.#fetch();
    this.decoder.call('command', clock(), commands[name]);
    this.soon();
  }

  /** @param {number} time @param {number} id @param {number} [tolerance] seconds */
  seek(time, id, tolerance = 0) {
    this.hasFailed = false;
    this.#fetch();
    // What the page knows is of another file than what would come.
    if (this.over) return this.#fail(this.over, id);
    this.decoder.call('seek', clock(), time, tolerance, id);
    this.soon();
  }

  /** @param {number} rate @param {number} mode 0: once, 1: loop, 2: ping-pong */
  setMotion(rate, mode) {
    this.decoder.call('set_motion', clock(), rate, mode);
    this.soon();
  }

  /** @param {Quality} quality @param {boolean} [isFixed] shown as it is, and nothing less */
  setQuality(quality, isFixed = this.link.isLocal) {
    const {maxLevel = all, maxTier = all, detail = details.full} = this.quality = quality;
    const mode = !this.isFetching ? network.metadata : this.isForSlices ? network.instant : network.all;
    // From memory all of it comes at once.
    this.decoder.call('set_quality', clock(), maxLevel, maxTier, detail, isFixed ? 1 : 0, mode);
    this.soon();
  }

  #fetch() {
    if (this.isFetching) return;
    this.isFetching = true;
    this.setQuality(this.quality);
  }
  isForSlices = false;

  // ---- running

  /** Runs once the task of now has ended. */
  soon() {
    if (this.isCalled || this.disposed) return;
    this.isCalled = true;
    this.port.postMessage(null);
  }

  #step() {
    try {
      const load = this.loads.shift();
      if (load) this.#load(load);
      this.run();
    } catch (error) {
      // Without memory, the module ends.
      if (!(error instanceof WebAssembly.RuntimeError)) throw error;
      this.hasFailed = false;
      this.#fail(new L4DError('OUT_OF_MEMORY', `the decoder has ended: ${error.message}`));
      this.dispose();
    }
  }

  run() {
    if (this.disposed) return;
    clearTimeout(this.timer);
    let count = 0;
    do {
      const {state, items} = this.decoder.update(clock());
      this.state = state;
      for (const item of items) this.#do(item);
      count = items.length;
    } while (count > 0);
    this.#tell();
    if (this.loads.length > 0) return this.soon();
    const seconds = this.state.wakeAt - clock();
    if (seconds < Infinity) this.timer = setTimeout(() => this.#step(), Math.min(Math.max(1000 * seconds, 0), 2 ** 31 - 1));
  }

  /** @param {import('./decoder.js').Item} item */
  #do(item) {
    if (item.kind === kinds.request) void this.#request(item);
    else if (item.kind === kinds.cancel) this.requests.get(item.id)?.abort();
    else if (item.kind === kinds.load) this.loads.push(item);
    else if (item.kind === kinds.unload) this.#remove(this.#keyOf(item));
    else this.#hear(item);
  }

  /** @param {import('./decoder.js').Item} item */
  async #request({id, source, offset, size, flags: bits}) {
    const control = new AbortController();
    this.requests.set(id, control);
    const {decoder} = this;
    /** What the engine hears of a request that is under way. @param {() => void} fn */
    const say = fn => {
      if (this.disposed || control.signal.aborted) return;
      fn();
      this.soon();
    };
    const isWhole = (bits & flags.whole) !== 0;
    let bytes = 0, isAll = false;
    /** @type {number} */
    let outcome = outcomes.ended;
    try {
      await this.link.send(decoder.uri(source), {
        offset, size, isWhole, isFresh: (bits & flags.fresh) !== 0, isPlaylist: (bits & flags.playlist) !== 0,
        isPart: this.isPlaylist
      }, control.signal, {
        answered: ({status, offset: at = 0, total = 0, version = 0, retryAfter = 0}) => say(() => {
          isAll = status === 200;
          decoder.call('answered', clock(), id, status, at, total, version, retryAfter);
        }),
        received: piece => say(() => {
          bytes += piece.length;
          decoder.received(clock(), id, piece);
        })
      });
      if (isAll && !this.isPlaylist) this.#setSize(bytes);
    } catch (error) {
      outcome = /** @type {any} */ (error)?.code === 'REQUEST' ? outcomes.forbidden : outcomes.failed;
    }
    this.requests.delete(id);
    say(() => decoder.call('finished', clock(), id, outcome));
  }

  /** How long the file is, where no answer has said it. @param {number} bytes */
  #setSize(bytes) {
    this.size = bytes;
    if (!this.info || this.info.fileBytes <= Number.MAX_SAFE_INTEGER && this.info.fileBytes > 0) return;
    this.info.fileBytes = bytes;
    this.post({type: 'size', bytes});
  }
  size = 0;  // of a file that came as a whole, maybe before its header was read

  /** @param {{stream: number, layer: number, bucket: number}} item */
  #keyOf({stream, layer, bucket}) { return this.isPlaylist ? `${stream}:${layer}/${bucket}` : `${layer}/${bucket}`; }

  /** @param {string} key */
  #remove(key) {
    this.heldRows -= roundedRows(this.held.get(key) ?? 0);
    if (this.held.delete(key)) this.post({type: 'removed', key});
  }

  /** What views still have of before `refresh` goes, the oldest first, until no more than so many rows are there. @param {number} rows */
  #removeStale(rows) {
    for (const key of this.stale.keys()) {
      if (this.heldRows + this.staleRows <= rows) return;
      this.#renew(key);
      this.post({type: 'removed', key});
    }
  }

  /** It is not of before any more. @param {string} key */
  #renew(key) {
    this.staleRows -= roundedRows(this.stale.get(key) ?? 0);
    this.stale.delete(key);
  }

  /** Decodes a bucket for the page. @param {import('./decoder.js').Item} item */
  #load(item) {
    const {decoder} = this;
    const {id, stream, layer, bucket, detail, units} = item;
    let status = 0, count = 0;
    const began = performance.now();
    try {
      decoder.select(stream);
      const rows = decoder.rows(layer, bucket, detail, this.state.shDegree);
      count = rows.count;
      this.#tellLosses(stream);
      const key = this.#keyOf(item);
      this.heldRows += roundedRows(count) - roundedRows(this.held.get(key) ?? 0);
      this.held.set(key, count);
      this.#renew(key);
      this.#removeStale(this.info?.maxRows ?? Infinity);
      this.#makeRoom();
      this.post({type: 'rows', key, stream, bucket: {layer, bucket, count: units, center: rows.center}, detail, ...rows},
                [rows.geometry.buffer, rows.sh.buffer]);
    } catch (error) {
      status = /** @type {any} */ (error).status;
      if (status === undefined) throw error;
    }
    this.decodeSeconds += (performance.now() - began) / 1000;
    decoder.call('loaded', clock(), id, count, status);
  }

  /** Views have room for some rows: of several streams, or of small buckets, there may be more. */
  #makeRoom() {
    if (!this.info || this.heldRows <= this.info.maxRows) return;
    this.info.maxRows = Math.min(Math.max(roundedRows(2 * this.heldRows), this.info.maxRows), roundedRows(this.mostRows));
    this.post({type: 'info', info: {...this.info}});
  }

  // ---- what the engine says

  /** @param {import('./decoder.js').Item} item */
  #hear({event, id, stream, offset, size, cause, time, value}) {
    if (event === events.stream) this.#setStream(value, cause);
    else if (event === events.shown) this.#answer(id, null);
    else if (event === events.failed) this.#answer(id, this.#errorOf(cause));
    else if (event === events.lost) this.#lose(stream, offset, size, cause);
    else if (event === events.retry) this.post({type: 'retry', message: this.#errorOf(cause).message});
    else if (event === events.down) this.isDown = true;
    else if (event === events.up) this.isDown = false;
    else if (event === events.wrapped) this.post({type: 'wrapped', time});
    else if (event === events.live) this.post({type: 'live', state: lives[value] ?? ''});
    else if (event === events.jumped) this.post({type: 'jumped', time, seconds: value});
    else if (event === events.grown) this.#grow();
    else if (event === events.opened) this.#meet(stream);
    else if (event === events.closed) this.post({type: 'closed', number: stream});
  }

  /** @param {number} cause */
  #errorOf(cause) {
    const code = causes[cause] ?? 'INTERNAL';
    const {failure} = this.link;
    return failure && cause <= linkCauses ? failure : new L4DError(code, `${this.url || 'the file'}: ${reasons[code] ?? code}`);
  }

  /** @param {number} stream @param {number} cause */
  #setStream(stream, cause) {
    if (stream === streams.failed) {
      const error = this.#errorOf(cause);
      if (!this.opening && causes[cause] === 'CHANGED') this.over = error;
      if (!this.opening) return this.#fail(error);
      this.opening.reject(error);
      this.opening = null;
    } else if (stream === streams.open || stream === streams.degraded) {
      this.hasFailed = false;
      if (!this.isPlaylist && !this.info) this.#meet(0);
    }
  }

  /** @param {Error} error @param {number} [id] of a seek */
  #fail(error, id) {
    if (this.hasFailed) return;
    this.hasFailed = true;
    this.post({type: 'error', error: L4DError.toData(error), turn: this.turn, id});
  }

  /** Of a seek. @param {number} id @param {Error | null} error */
  #answer(id, error) {
    const seek = this.seeks.get(id);
    if (seek) return error ? seek.reject(error) : seek.resolve();
    this.lastSeek = id;
    if (error) this.#fail(error, id);
    else this.post({type: 'shown', id});
  }

  /** Takes in what a stream that is open says of itself. @param {number} number */
  #meet(number) {
    const {decoder} = this;
    decoder.select(number);
    const info = decoder.info();
    if (info.fileBytes > Number.MAX_SAFE_INTEGER) info.fileBytes = this.size;
    const {timeBegin, duration, numFrames, rateNumerator, rateDenominator} = info;
    this.post({type: 'stream', number, timeline: {timeBegin, duration, numFrames, rateNumerator, rateDenominator}});
    const room = roundedRows(2 * info.numGaussians + 65536);
    const before = this.info;
    if (!before) {
      this.info = {...info, maxRows: Math.min(roundedRows(this.mostRows), room)};
      return;
    }
    const tiers = info.tiers.length > before.tiers.length ? info.tiers : before.tiers;
    this.info = {...before, tiers, tools: before.tools | info.tools, shDegree: Math.max(before.shDegree, info.shDegree),
                 numLayers: Math.max(before.numLayers, info.numLayers), lastTier: Math.max(before.lastTier, info.lastTier)};
    const keys = /** @type {const} */ (['tools', 'shDegree', 'numLayers', 'lastTier']);
    if (keys.some(key => before[key] !== /** @type {MovieInfo} */ (this.info)[key])) this.post({type: 'info', info: {...this.info}});
  }

  /** The playlist is longer, or complete. */
  #grow() {
    if (!this.opening) this.post({type: 'grown', members: this.decoder.shown(), live: this.#isLive()});
  }

  #isLive() { return this.state.live > 0 && this.state.live < 5; }

  // ---- losses

  /** @param {number} stream @param {number} offset @param {number} size @param {number} cause */
  #lose(stream, offset, size, cause) {
    const error = this.#errorOf(cause);
    if (size === 0 && this.isPlaylist) {
      const member = this.decoder.shown().find(m => m.stream === stream);
      this.#addLosses([{code: error.code, clause: '', offset: -1, member: stream, begin: member?.begin, end: member?.end, detailOnly: false}]);
    } else {
      // Of pages, decoding says more.
      try {
        this.decoder.select(stream);
        const {from, until} = this.state;
        this.decoder.call('look', from, Math.max(until, from));
        this.#tellLosses(stream);
      } catch {
        // The stream is not open.
      }
    }
    if (!this.tolerant) this.#fail(new L4DError(error.code, error.message, {offset}));
  }

  /** Of what the last call of a stream has lost. @param {number} stream */
  #tellLosses(stream) {
    const member = this.isPlaylist ? {member: stream} : {};
    // What is not here yet is not lost.
    const losses = this.decoder.losses().filter(({code}) => code !== 'IO' && code !== 'NEED_DATA');
    if (losses.length > 0) this.#addLosses(losses.map(loss => ({...loss, ...member})));
  }

  /** Reports each once. @param {any[]} losses */
  #addLosses(losses) {
    const told = losses.filter(({code, layer, bucket, offset, member, detailOnly}) => {
      // A page of the directory begins at the first bucket that a query wants of it.
      const key = [code, member, layer, offset >= 0 ? offset : `bucket ${bucket}`, detailOnly].join();
      return !this.lost.has(key) && this.lost.add(key);
    });
    if (told.length > 0) this.post({type: 'loss', losses: told});
  }

  // ---- what the page hears

  /** The rung that is shown. */
  #rung() {
    const {rung, numRungs} = this.state;
    const tiers = this.info?.tiers ?? [0];
    return {tier: tiers[Math.min(rung, tiers.length - 1)] ?? 0, detail: rung >= numRungs - 1 ? 'full' : 'base'};
  }

  #tell() {
    const {state} = this;
    if (this.opening && this.info && (state.stream === streams.open || state.stream === streams.degraded)) this.#opened();
    if (!this.info || this.opening) return;
    const {motion, ready, from, until, time, at, velocity} = state;
    // While it moves, another anchor of the same line is no news.
    const line = (time - at * velocity).toFixed(velocity === 0 ? 9 : 4);
    const rung = ready ? this.#rung() : {tier: 0, detail: 'none'};
    if (rung.detail === 'full') this.#removeStale(this.heldRows);
    const told = [this.turn, motion, from, until, line, velocity, rung.tier, rung.detail, this.lastSeek].join();
    if (told !== this.told) {
      this.told = told;
      this.post({type: 'state', turn: this.turn, id: this.lastSeek, isPlaying: motion === motions.playing, isWaiting: motion === motions.waiting,
                 hasEnded: motion === motions.ended, from, until, time, at, velocity, ...rung});
    }
    if (this.isDown && !this.hasFailed && (motion === motions.waiting || !ready)) this.#fail(this.#errorOf(1));
    const now = performance.now();
    if (now - this.lastProgress < 200 && this.requests.size + this.loads.length > 0) return;
    const progress = {type: 'progress', ...this.statistics(), buffered: this.decoder.buffered()};
    const text = JSON.stringify(progress);
    if (text === this.lastText) return;
    this.lastText = text;
    this.lastProgress = now;
    this.post(progress);
  }
  lastText = '';

  #opened() {
    const {opening, info, state} = this;
    this.opening = null;
    if (!info) return;
    if (this.isPlaylist) {
      info.timeBegin = state.begin;
      info.duration = state.end - state.begin;
      info.numFrames = Math.round(info.duration * info.frameRate);
    }
    const playlist = this.isPlaylist ? {members: this.decoder.shown(), live: this.#isLive(), startTime: state.time, distance: state.liveDistance} : undefined;
    opening?.resolve({...info, playlist});
  }

  statistics() {
    const {state, decoder, held} = this;
    let rows = 0;
    for (const count of held.values()) rows += count;
    return {
      bytes: state.bytes ?? 0, throughput: 8 * (state.throughput ?? 0), rows, lost: this.lost.size, requests: state.requests ?? 0,
      decodeSeconds: this.decodeSeconds, memoryBytes: decoder.memoryBytes
    };
  }

  // ---- slices

  /**
   * The 3D Gaussians of an instant, of an engine for slices, one after the other.
   * @param {number} time @param {Quality & {sh?: boolean}} options @param {AbortSignal} signal
   * @returns {Promise<import('./movie.js').Slice>}
   */
  slice(time, options, signal) {
    const next = this.slicing.then(() => this.#slice(time, options, signal));
    this.slicing = next.then(() => {}, () => {});
    return next;
  }
  slicing = Promise.resolve();

  /** @param {number} time @param {Quality & {sh?: boolean}} options @param {AbortSignal} signal */
  async #slice(time, {sh = true, ...quality}, signal) {
    const id = ++this.lastSeek;
    const abort = () => this.seeks.get(id)?.reject(abortError());
    const shown = new Promise((resolve, reject) => { this.seeks.set(id, {resolve: () => resolve(undefined), reject}); });
    signal.addEventListener('abort', abort, {once: true});
    if (signal.aborted || this.disposed) abort();
    else {
      this.setQuality(quality, true);
      this.seek(time, id);
    }
    try {
      await shown;
      const slice = this.decoder.slice(this.state.time, sh);
      if (!this.isPlaylist) this.decoder.select(0);
      if (!this.isPlaylist) this.#tellLosses(0);
      return slice;
    } finally {
      signal.removeEventListener('abort', abort);
      this.seeks.delete(id);
    }
  }
}
