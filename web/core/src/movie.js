// SPDX-License-Identifier: Apache-2.0
import {Emitter} from './emitter.js';
import {abortError, L4DError} from './errors.js';
import {frameOfTime} from './timeline.js';
import {inlined, startWorker, workerError} from './workers.js';

/**
 * @typedef {object} Slice the 3D Gaussians of an instant
 * @property {number} count @property {number} shDegree
 * @property {Float32Array} position [count, 3]
 * @property {Float32Array} covariance [count, 6] xx xy xz yy yz zz
 * @property {Float32Array} opacity [count]
 * @property {Float32Array | null} sh [count, (shDegree + 1)^2, 3]; colour = 0.5 + sum
 */
/**
 * @typedef {object} BucketRows Gaussians of a span of time, as added to a view or an adapter
 * @property {string} key a later one of the same key replaces this one
 * @property {number} stream that they are of: see Movie.streamsAt()
 * @property {import('./decoder.js').Bucket} bucket
 * @property {number} detail 0: full, 1: base colours
 * @property {number} count @property {number} shStride @property {number} center
 * @property {Float32Array} geometry @property {Uint16Array} sh
 */
/**
 * @typedef {object} Loss a part of the stream that cannot be shown
 * @property {string} code "TRUNCATED", "CORRUPT", "NOT_FOUND": why
 * @property {string} clause the rule that is broken, "" if none @property {number} offset the byte, -1 if none
 * @property {number} [layer] @property {number} [bucket] @property {number} [gaussians] that lack
 * @property {boolean} detailOnly they are shown in base colours
 * @property {number} [member] of a presentation of several streams
 * @property {number} [begin] @property {number} [end] seconds: all of the member is lost
 */
/**
 * @typedef {object} LiveOptions
 * @property {number} [distance] seconds behind the end (two target durations of the playlist)
 * @property {number} [slowest] @property {number} [fastest] factors of the rate on the way there (0.95, 1.05)
 * @property {number} [staleAfter] seconds without growth, after which it is stale (three target durations, at least 6)
 */
/**
 * @typedef {object} OpenOptions
 * @property {AbortSignal} [signal]
 * @property {number} [cacheBytes] of the file, kept in memory for later (256 MiB); what the present instant needs stays whatever
 *   it is, and so does a file whose server knows no ranges
 * @property {number} [maxRows] Gaussians held for showing, each bucket rounded up to 256 (2^21)
 * @property {boolean} [tolerant] show the intact rest of a damaged stream (true); `losses` and event 'loss' name what it lacks
 * @property {Record<string, string>} [headers] of requests to the host of the source; those of another origin must allow them
 * @property {RequestCredentials} [credentials] of requests
 * @property {(request: import('./link.js').Request) => RequestChange | Promise<RequestChange>} [request] is called before each
 *   request, also one that is sent again, and may change what it returns: an address that is signed, a token of now
 * @property {RequestCache} [cache] how requests use the browser's cache ('default': as the server says); 'no-store': not at all
 * @property {number} [timeout] seconds without a byte, after which a request has failed (10)
 * @property {number} [retries] how often a request is sent again that has failed (3)
 * @property {(string | URL)[]} [bases] addresses of folders with the same files, the first of which the source is relative to:
 *   what fails at one is sent to the next
 * @property {'auto' | 'metadata'} [preload] metadata: reads header and directory, and no pages before a seek or play()
 * @property {boolean} [playlist] of several streams (whether the path of the URL ends with .m3u8)
 * @property {LiveOptions} [live] how a playlist that grows is followed
 * @property {string | URL} [wasmUrl] where l4d.wasm lies (beside this module)
 * @property {() => Worker} [worker] makes the worker, for pages that bundle it themselves
 */

/** @typedef {Partial<import('./link.js').Request> | void} RequestChange */

/** @type {Record<string, [number, number]>} */
const liveRanges = {distance: [0, 3600], slowest: [0.5, 1], fastest: [1, 2], staleAfter: [0, 86400]};

/**
 * Opens a stream.
 * @param {string | URL | Blob | ArrayBuffer | ArrayBufferView} from an ArrayBuffer is taken over; the bytes of a view are copied
 * @param {OpenOptions} [options]
 */
export const open = async (from, options = {}) => {
  if (options.signal?.aborted) throw abortError();
  for (const name of /** @type {const} */ (['cacheBytes', 'maxRows', 'timeout', 'retries'])) {
    const value = options[name];
    if (value === undefined || typeof value === 'number' && value >= 0) continue;
    throw invalid(`${name} is ${String(value)}; it must be a number from 0`);
  }
  for (const [name, value] of Object.entries(options.live ?? {})) {
    const [least, most] = liveRanges[name] ?? [];
    if (least === undefined) throw invalid(`live.${name} is unknown; live has ${Object.keys(liveRanges).join(', ')}`);
    if (value === undefined || value >= least && value <= most) continue;
    throw invalid(`live.${name} is ${String(value)}; it must be from ${least} to ${most}`);
  }
  const movie = new Movie(options);
  try {
    await movie.start(from);
    return movie;
  } catch (error) {
    movie.dispose();
    throw error;
  }
};

/** Of requestAnimationFrame, where there is one. @type {(fn: () => void) => void} */
const nextFrame = typeof requestAnimationFrame === 'function' ? requestAnimationFrame.bind(globalThis) : fn => void setTimeout(fn, 16);
/** Seconds of the clock that the worker has, too. */
const clock = () => (performance.timeOrigin + performance.now()) / 1000;
const playbacks = /** @type {const} */ (['once', 'loop', 'ping-pong']);
const near = 0.15;  // seconds that a movie may be away from the sound that it follows
/** @typedef {import('./decoder.js').Shown} Shown */
/** @typedef {import('./decoder.js').Shown & {members: Shown[]}} Span a media member, and all that is shown with it */

/** @param {string} message */
const invalid = message => new L4DError('INVALID_ARGUMENT', message);

/** @param {unknown} time */
const notTime = time => invalid(`a time is a finite number of seconds, not ${String(time)}`);

/** Of levels and tiers. @param {string} name @param {unknown} value */
const limitOf = (name, value) => {
  const isWhole = typeof value === 'number' && (Number.isInteger(value) || value === Infinity) && value >= 0;
  if (!isWhole) throw invalid(`${name} is ${String(value)}; it must be a whole number from 0, or Infinity`);
  return Math.min(value, 0xffffffff);
};

/** @template {string} Detail @param {Detail} detail @param {Detail[]} details */
const detailOf = (detail, details) => {
  if (!details.includes(detail)) throw invalid(`detail is ${String(detail)}; it must be ${details.join(' or ')}`);
  return detail;
};

/** @param {string | URL} address @param {string} [base] the page */
const addressOf = (address, base = globalThis.location?.href) => {
  if (typeof address !== 'string' && !(address instanceof URL)) {
    throw invalid('a source is a URL, a Blob or bytes');
  }
  try {
    return new URL(address, base).href;
  } catch {
    throw invalid(`${String(address).slice(0, 100)} is no URL`);
  }
};

/** @param {Shown[]} shown in the order of time, what is shown with a media member after it @returns {Span[]} */
const spansOf = shown => {
  /** @type {Span[]} */
  const spans = [];
  for (const member of shown) {
    if (member.isStanding) spans.at(-1)?.members.push(member);
    else spans.push({...member, members: [member]});
  }
  return spans;
};

/**
 * An open stream, and its time, which an engine in the worker moves. Events: 'time' (seconds), 'play', 'pause', 'ended', 'stall',
 * 'resume', 'ready', 'progress', 'loss', 'error', 'rows', 'removed', 'retry'. Of a presentation of several streams also 'span' (the
 * media member that is shown from now on), 'grown' (it has become longer, or has ended), 'live' (`liveState` is another one), 'jumped'
 * (it was too far behind, and goes on at `time`) and 'info' (`info` has changed).
 * 'refreshed' comes before what refresh() sends again.
 */
export class Movie extends Emitter {
  /** @param {OpenOptions} options */
  constructor(options) {
    super();
    this.options = options;
    this.worker = options.worker?.() ?? startWorker(
      () => new Worker(new URL('./worker.js', import.meta.url), {type: 'module'}), inlined.worker, 'worker.js', import.meta.url);
    /** @type {Map<number, {resolve: (value: any) => void, reject: (reason: any) => void}>} */
    this.calls = new Map();
    this.nextId = 1;
    /** Counts commands: what the worker says before it knows of the last one is not true any more. */
    this.turn = 0;
    /** @type {import('./engine.js').MovieInfo} */
    this.info = /** @type {any} */ (null);
    this.buffered = /** @type {[number, number][]} */ ([]);
    this.statistics = {bytes: 0, throughput: 0, rows: 0, lost: 0, requests: 0, decodeSeconds: 0, memoryBytes: 0};
    /** What can be shown: from when until when, and up to which tier in which detail. */
    this.ready = {from: 0, until: 0, detail: 'none', tier: 0};
    /** Whether the last request failed: no more of it comes. */
    this.hasFailed = false;
    /** @type {{id: number, resolve: () => void, reject: (reason: any) => void} | null} */
    this.seeking = null;
    /** @type {'auto' | 'base' | 'full'} */
    this.detailWanted = 'auto';
    this.levelLimit = 0xffffffff;
    this.tierLimit = 0xffffffff;
    /** Room that a view needs: Gaussians, each bucket rounded up to 256. */
    this.maxRows = options.maxRows ?? 2 ** 21;
    /** What cannot be shown, as far as it is known: of what has been wanted. @type {Loss[]} */
    this.losses = [];
    this.disposed = false;
    /** Of a presentation of several streams. @type {Span[] | null} */
    this.spans = null;
    /** @type {Map<number, import('./timeline.js').Timeline>} of its streams that are open */
    this.timelines = new Map();
    this.isLive = false;
    /** @type {number | null} of a playlist */
    this.firstTime = null;
    this.behind = 0;
    // Of the time.
    this.time = 0;
    /** Where the time is at a moment, how fast it moves from there, and within what. */
    this.anchor = {time: 0, at: 0, velocity: 0, from: -Infinity, until: Infinity};
    this.isPaused = true;
    this.isStalled = false;
    this.rateWanted = 1;
    /** @type {'once' | 'loop' | 'ping-pong'} */
    this.playbackWanted = 'once';
    /** @type {HTMLMediaElement | null} whose time it follows */
    this.media = null;
    this.isTicking = false;
    this.worker.onmessage = event => this.#receive(event.data);
    this.worker.onerror = event => void workerError(this.worker, event).then(error => this.#fail(error));
  }

  /** Of `open`. @param {string | URL | Blob | ArrayBuffer | ArrayBufferView} from */
  async start(from) {
    /** @type {any} */
    const source = {};
    const {headers, credentials, cache, timeout, retries = 3, request, live} = this.options;
    const bases = (this.options.bases ?? []).map(base => addressOf(base));
    /** @type {Transferable[]} */
    const transfer = [];
    if (from instanceof ArrayBuffer) transfer.push(source.buffer = from);
    else if (ArrayBuffer.isView(from)) {
      source.buffer = new Uint8Array(from.buffer, from.byteOffset, from.byteLength).slice().buffer;
      transfer.push(source.buffer);
    } else if (from instanceof Blob) source.blob = from;
    else source.url = addressOf(from, bases[0]);
    const {cacheBytes, maxRows, tolerant, preload} = this.options;
    const wasm = this.options.wasmUrl ? undefined : inlined.wasm;
    const wasmUrl = wasm ? '' : addressOf(this.options.wasmUrl ?? new URL('./l4d.wasm', import.meta.url));
    const isPlaylist = source.url !== undefined &&
      (this.options.playlist ?? /\.m3u8$/i.test(new URL(source.url).pathname));
    const {playlist, ...info} = await this.#call('open', {
      source, isPlaylist, wasm, wasmUrl, options: {cacheBytes, maxRows, tolerant, preload, timeout, failures: retries + 1, live},
      link: {headers, credentials, cache, bases}, asks: request !== undefined
    }, this.options.signal, transfer);
    this.info = info;
    this.maxRows = info.maxRows;
    this.time = this.timeBegin;
    if (playlist) {
      this.behind = playlist.distance;
      this.spans = spansOf(playlist.members);
      this.isLive = playlist.live;
      if (!playlist.live) this.firstTime = playlist.startTime;
    }
    this.#anchor(this.startTime);
    if (preload !== 'metadata') this.#order('seek', {time: this.startTime, id: this.nextId++});
  }

  get duration() { return this.info.duration; }
  get timeBegin() { return this.info.timeBegin; }
  get timeEnd() { return this.info.timeBegin + this.info.duration; }
  /**
   * Where playing begins: where the first member is that can be shown; of a file that grows, so near to its end that it
   * plays without waiting.
   */
  get startTime() {
    return this.live ? Math.max(this.timeBegin, this.timeEnd - this.behind) : this.firstTime ?? this.timeBegin;
  }
  /** Whether it is still being made: `timeEnd` grows. */
  get live() { return this.isLive; }
  /** How that goes: 'on-time', 'behind', 'stale', 'restarted', 'ended'; '': it is no recording. */
  liveState = '';
  get currentTime() { return this.time; }
  set currentTime(time) { void this.seek(time).catch(() => {}); }
  get paused() { return this.isPaused; }
  get rate() { return this.rateWanted; }
  set rate(rate) {
    if (typeof rate !== 'number' || !Number.isFinite(rate)) throw invalid(`a rate is a finite number, not ${rate}`);
    this.rateWanted = rate;
    this.#setMotion();
  }
  get loop() { return this.playback === 'loop'; }
  set loop(loop) { this.playback = loop ? 'loop' : 'once'; }
  /** What comes after the end. 'ping-pong': all of it backwards. @returns {'once' | 'loop' | 'ping-pong'} */
  get playback() { return this.playbackWanted; }
  set playback(playback) {
    if (!playbacks.includes(playback)) throw invalid(`playback is once, loop or ping-pong, not ${playback}`);
    this.playbackWanted = playback;
    this.#setMotion();
  }
  get detail() { return this.detailWanted; }
  set detail(detail) {
    this.detailWanted = detailOf(detail, ['auto', 'base', 'full']);
    this.#setQuality();
  }
  /** @param {'auto' | 'base' | 'full'} detail */
  setDetail(detail) { this.detail = detail; }
  /** The finest temporal level that is shown. */
  get maxLevel() { return this.levelLimit; }
  set maxLevel(level) {
    this.levelLimit = limitOf('maxLevel', level);
    this.#setQuality();
    this.emit('level', this.levelLimit);
  }
  /** The last tier that is fetched and shown: the first, 0, is a coarse picture. `info.lastTier` is the last that there is. */
  get maxTier() { return this.tierLimit; }
  set maxTier(tier) {
    this.tierLimit = limitOf('maxTier', tier);
    this.#setQuality();
    this.emit('tier', this.tierLimit);
  }

  /** What is shown at a time: between spans, what is seen at their ends. @param {number} time @returns {{span: Span, time: number}} */
  #spanAt(time) {
    const spans = /** @type {Span[]} */ (this.spans);
    let low = 0, high = spans.length;  // the first that begins later
    while (low < high) {
      const middle = (low + high) >> 1;
      if (spans[middle].begin > time) high = middle;
      else low = middle + 1;
    }
    const [before, after] = [spans[low - 1], spans[low]];
    const isNext = !before || after && time >= before.end && after.begin - time < time - before.end;
    const span = isNext ? after : before;
    return {span, time: Math.min(Math.max(time, span.begin), span.end)};
  }

  /**
   * The streams that are shown at a time: rows of others are not. `time` is in seconds of the stream, `frame` is the one that
   * it belongs to. A file of one stream has the one of number 0.
   * @param {number} time @returns {import('./timeline.js').StreamTime[]}
   */
  streamsAt(time) {
    if (!this.spans) return [{stream: 0, time, frame: frameOfTime(this.info, time)}];
    const shown = this.#spanAt(time);
    const streams = [];
    for (const {stream, shift} of shown.span.members) {
      const timeline = this.timelines.get(stream);
      if (!timeline) continue;
      const {timeBegin, duration} = timeline;
      const own = Math.min(Math.max(shown.time - shift, timeBegin), timeBegin + duration);
      streams.push({stream, time: own, frame: frameOfTime(timeline, own)});
    }
    return streams;
  }

  /** Seconds that can be shown from here without another byte. */
  get secondsAhead() {
    const {from, until} = this.ready;
    return this.currentTime >= from - 1e-6 ? Math.max(until - this.currentTime, 0) : 0;
  }

  play() {
    if (!this.isPaused) return;
    this.isPaused = false;
    const {time, rateWanted: rate} = this;
    const isTurning = this.playback === 'ping-pong';
    if (time >= this.timeEnd && rate > 0 && !this.live && !isTurning) void this.seek(this.timeBegin).catch(() => {});
    if (time <= this.timeBegin && rate < 0 && !isTurning) void this.seek(this.timeEnd).catch(() => {});
    this.#order('play');
    this.emit('play');
    this.#tick();
  }

  pause() {
    if (this.isPaused) return;
    this.#move();
    this.isPaused = true;
    this.isStalled = false;
    this.anchor.velocity = 0;
    this.anchor.time = this.time;
    this.#order('pause');
    this.emit('pause');
  }

  /** Takes the time from an audio or video element; null: from the clock again. @param {HTMLMediaElement | null} media */
  sync(media) {
    this.media = media;
    this.#setMotion();
    if (media) this.#tick();
  }

  /**
   * Resolves when the instant can be shown, in base colours at least.
   * @param {number} time seconds
   * @param {{signal?: AbortSignal, tolerance?: number}} [options] tolerance: so many seconds away is near enough, as while a finger
   *   drags: one instant after the other is shown, the newest last
   * @returns {Promise<void>}
   */
  seek(time, {signal, tolerance = 0} = {}) {
    if (signal?.aborted) return Promise.reject(abortError());
    if (this.disposed) return Promise.reject(abortError('disposed'));
    if (!Number.isFinite(time)) return Promise.reject(notTime(time));
    const at = Math.min(Math.max(time, this.timeBegin), this.timeEnd);
    this.seeking?.reject(abortError('another seek'));
    const id = this.nextId++;
    const result = new Promise((resolve, reject) => {
      this.seeking = {id, resolve: () => resolve(undefined), reject};
      signal?.addEventListener('abort', () => {
        if (this.seeking?.id === id) this.seeking = null;
        reject(abortError());
      }, {once: true});
    });
    // While it drags, what is shown stays until there is more.
    if (tolerance === 0) {
      this.ready = {from: at, until: -Infinity, detail: 'none', tier: 0};
      this.#anchor(at);
    }
    this.hasFailed = false;
    this.#order('seek', {time: at, id, tolerance});
    this.#setTime(at);
    return /** @type {Promise<void>} */ (result);
  }

  /**
   * The 3D Gaussians at `time`, for anything else than the player.
   * @param {number} time
   * @param {{sh?: boolean, detail?: 'base' | 'full', maxTier?: number, signal?: AbortSignal}} [options]
   * @returns {Promise<Slice>}
   */
  async slice(time, {sh = true, detail = 'full', maxTier = Infinity, signal} = {}) {
    if (!Number.isFinite(time)) throw notTime(time);
    const isBase = detailOf(detail, ['base', 'full']) === 'base';
    return this.#call('slice', {time, options: {sh, detail: isBase ? 1 : 0, maxTier: limitOf('maxTier', maxTier)}}, signal);
  }

  /**
   * Buckets as they come and go, for adapters: {added: BucketRows} or {removed: key}. Ends with the movie.
   * @param {{signal?: AbortSignal}} [options]
   * @returns {AsyncGenerator<{added?: BucketRows, removed?: string}>}
   */
  async *rows({signal} = {}) {
    /** @type {any[]} */
    const queue = [];
    let wake = () => {};
    const push = (/** @type {any} */ item) => { queue.push(item); wake(); };
    const ends = [
      this.on('rows', rows => push({added: rows})), this.on('removed', key => push({removed: key})),
      this.on('disposed', () => wake())
    ];
    signal?.addEventListener('abort', () => wake(), {once: true});
    this.refresh();
    try {
      while (!this.disposed && !signal?.aborted) {
        if (queue.length > 0) yield queue.shift();
        else await new Promise(resolve => { wake = () => resolve(undefined); });
      }
    } finally {
      for (const end of ends) end();
    }
  }

  /** Sends all rows again, to a listener that is new. */
  refresh() { this.#order('refresh'); }

  /** Brings `statistics` up to date, which events 'progress' do a few times a second. */
  async refreshStatistics() { this.statistics = await this.#call('statistics', {}); }

  dispose() {
    if (this.disposed) return;
    this.disposed = true;
    this.worker.postMessage({type: 'dispose'});
    const gone = abortError('disposed');
    for (const {reject} of this.calls.values()) reject(gone);
    this.calls.clear();
    this.seeking?.reject(gone);
    this.emit('disposed');
    this.listeners.clear();
  }

  // ---- to the worker

  /** A command, which what the worker says from then on follows. @param {string} type @param {any} [message] */
  #order(type, message = {}) {
    this.worker.postMessage({type, turn: ++this.turn, ...message});
    if (type === 'seek') this.seekTurn = this.turn;
  }
  seekTurn = 0;

  #setMotion() {
    if (!this.info) return;
    const factor = this.media?.playbackRate ?? 1;
    this.#order('motion', {rate: this.rateWanted * factor, mode: playbacks.indexOf(this.playbackWanted)});
  }

  #setQuality() {
    const detail = this.detailWanted === 'base' ? 1 : 0;
    this.#order('quality', {quality: {maxLevel: this.levelLimit, maxTier: this.tierLimit, detail}});
  }

  /** @param {string} type @param {any} message @param {AbortSignal} [signal] @param {Transferable[]} [transfer] @returns {Promise<any>} */
  #call(type, message, signal, transfer = []) {
    if (this.disposed) return Promise.reject(abortError('disposed'));
    const id = this.nextId++;
    return new Promise((resolve, reject) => {
      this.calls.set(id, {resolve, reject});
      signal?.addEventListener('abort', () => {
        this.worker.postMessage({type: 'abort', id});
        if (this.calls.delete(id)) reject(abortError());
      }, {once: true});
      this.worker.postMessage({type, id, ...message}, transfer);
    });
  }

  // ---- time

  /** Rests at a time until the worker says more. @param {number} time */
  #anchor(time) {
    this.anchor = {time, at: clock(), velocity: 0, from: -Infinity, until: Infinity};
    this.time = time;
  }

  /** @param {number} time */
  #setTime(time) {
    this.time = time;
    if (this.spans && this.spans.length > 0) this.#showSpan(time);
    this.emit('time', time);
  }

  /** To where the time is now. */
  #move() {
    const {time, at, velocity, from, until} = this.anchor;
    const now = Math.min(Math.max(time + (clock() - at) * velocity, from), until);
    if (now !== this.time) this.#setTime(now);
  }

  /** Follows the sound; the worker fetches what comes next as if it was its own time. @param {HTMLMediaElement} media */
  #follow(media) {
    const time = Math.min(this.timeBegin + media.currentTime, this.timeEnd);
    if (media.paused !== this.isFollowPaused) {
      this.isFollowPaused = media.paused;
      this.#order(media.paused ? 'pause' : 'play');
    }
    const {time: from, at, velocity} = this.anchor;
    const now = clock();
    const isAway = Math.abs(from + (now - at) * velocity - time) > near;
    if (isAway && now - this.followedAt > 0.25) {
      this.followedAt = now;
      this.#order('seek', {time, id: this.nextId++});
    }
    if (Math.abs(time - this.time) > 1e-6) this.#setTime(time);
  }
  isFollowPaused = true;
  followedAt = 0;

  /** Moves frame by frame, while there is something to move. */
  #tick() {
    if (this.isTicking || this.disposed || this.isPaused && !this.media) return;
    this.isTicking = true;
    nextFrame(() => {
      this.isTicking = false;
      if (this.disposed) return;
      if (this.media) this.#follow(this.media);
      else if (!this.isPaused) this.#move();
      this.#tick();
    });
  }

  // ---- what the worker says

  /** @param {any} data */
  #receive(data) {
    const {type, ...rest} = data;
    if (type === 'answer') {
      const call = this.calls.get(data.id);
      this.calls.delete(data.id);
      if (data.error) call?.reject(errorOf(data.error));
      else call?.resolve(data.result);
    } else if (type === 'request') {
      void this.#change(data);
    } else if (type === 'state') {
      this.#setState(rest);
    } else if (type === 'wrapped') {
      // Both ends are seen, however seldom frames are.
      if (!this.isPaused && !this.media) this.#setTime(data.time);
    } else if (type === 'shown') {
      if (this.seeking?.id === data.id) this.shownSeek = data.id;
    } else if (type === 'error') {
      // Of an earlier instant: the one of now is still tried.
      const isOld = data.id ? data.id !== this.seeking?.id : data.turn < this.seekTurn;
      if (!isOld) this.#fail(errorOf(data.error));
    } else if (type === 'progress') {
      const {buffered, ...statistics} = rest;
      this.buffered = buffered;
      this.statistics = statistics;
      this.emit('progress', rest);
    } else if (type === 'removed') {
      this.emit('removed', data.key);
    } else if (type === 'stream') {
      this.timelines.set(data.number, data.timeline);
    } else if (type === 'closed') {
      this.timelines.delete(data.number);
    } else if (type === 'grown') {
      this.#grow(data);
    } else if (type === 'live') {
      this.liveState = data.state;
      this.emit('live', rest);
    } else if (type === 'size') {
      this.info = {...this.info, fileBytes: data.bytes};
    } else if (type === 'info') {
      const {timeBegin, duration, numFrames} = this.info;
      this.info = {...data.info, timeBegin, duration, numFrames};
      this.maxRows = this.info.maxRows;
      this.emit('info', this.info);
    } else if (type === 'loss') {
      this.losses.push(...data.losses);
      this.emit('loss', data.losses);
    } else {
      this.emit(type, rest);
    }
  }
  shownSeek = 0;

  /** @param {any} state of the engine */
  #setState({turn, id, isPlaying, isWaiting, hasEnded, from, until, time, at, velocity, tier, detail}) {
    if (turn !== this.turn) return;
    const before = this.ready;
    this.ready = {from, until: detail === 'none' ? -Infinity : until, tier, detail};
    this.anchor = {time, at, velocity, from: detail === 'none' ? -Infinity : from, until: detail === 'none' ? Infinity : until};
    if (!this.media) this.#move();
    if (detail !== 'none') {
      const isNews = before.detail !== detail || before.tier !== tier || before.from !== from || before.until !== until;
      this.hasFailed = false;
      if (isNews || this.shownSeek) this.emit('ready', {...this.ready, id});
    }
    if (this.seeking && this.shownSeek === this.seeking.id) {
      this.seeking.resolve();
      this.seeking = null;
    }
    this.shownSeek = 0;
    if (this.isPaused) return;
    if (isWaiting !== this.isStalled && (isWaiting || isPlaying || hasEnded)) {
      this.isStalled = isWaiting;
      this.emit(isWaiting ? 'stall' : 'resume');
    }
    if (!hasEnded || this.media) return;
    this.isPaused = true;
    this.emit('pause');
    this.emit('ended');
  }

  /** Before a request, as the worker asks. @param {{id: number, request: import('./link.js').Request}} message */
  async #change({id, request}) {
    /** @type {any} */
    let answer;
    try {
      const {url, headers, credentials} = await this.options.request?.(request) ?? request;
      answer = Object.fromEntries(Object.entries({url, headers, credentials}).filter(([, value]) => value !== undefined));
      if (url !== undefined) answer.url = addressOf(url, request.url);
    } catch (error) {
      answer = {error: L4DError.toData(new L4DError('REQUEST', `${request.url}: ${/** @type {any} */ (error)?.message ?? error}`))};
    }
    this.worker.postMessage({type: 'requested', id, answer});
  }

  /** @param {{members: Shown[], live: boolean}} message */
  #grow({members, live}) {
    this.spans = spansOf(members);
    this.isLive = live;
    const begin = this.spans[0]?.begin ?? 0;
    const duration = (this.spans.at(-1)?.end ?? 0) - begin;
    this.info = {...this.info, timeBegin: begin, duration, numFrames: Math.round(duration * this.info.frameRate)};
    this.emit('grown', {duration, live});
  }

  /** @param {number} time */
  #showSpan(time) {
    const {span: {stream, begin, end}} = this.#spanAt(time);
    if (stream === this.shownStream) return;
    this.shownStream = stream;
    this.emit('span', {number: stream, begin, end});
  }
  shownStream = -1;

  /** @param {Error} error */
  #fail(error) {
    this.seeking?.reject(error);
    this.seeking = null;
    for (const {reject} of this.calls.values()) reject(error);
    this.calls.clear();
    this.hasFailed = true;
    this.emit('error', error);
  }
}

/** @param {any} data */
const errorOf = data => data.code === 'ABORTED' ? abortError(data.message) : L4DError.fromData(data);
