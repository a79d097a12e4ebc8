// SPDX-License-Identifier: Apache-2.0
// A presentation of several streams: one timeline over a session for each member that is shown, or will be soon. Runs in a
// worker in place of a session, and is driven as one.
import {instantiate} from './decoder.js';
import {abortError, L4DError} from './errors.js';
import {Link} from './link.js';
import {Part, slack} from './part.js';
import {appended, loadPlaylist} from './playlist.js';
import {joinSlices, widenHarmonics} from './joined.js';
import {roundedRows} from './session.js';
import {Spans} from './spans.js';

const mostOpen = 12;       // members that are open beside those that are wanted
const mostStages = 16;     // media members ahead
const leastAhead = 4;      // seconds of the lowest rung, before higher ones are fetched while it plays
const mostFailures = 5;    // of a playlist, one after the other
const mostTransfers = 8;   // that a new session is given

/** @typedef {import('./session.js').Goal} Goal */
/** @typedef {import('./playlist.js').Member} Member */
/** @typedef {{media: Member, members: Member[], begin: number, end: number}} Stage what is shown for a while */

export class Presentation {
  /**
   * @param {WebAssembly.Module | Promise<WebAssembly.Module>} module @param {string} url of the playlist
   * @param {(message: any, transfer?: Transferable[]) => void} post
   * @param {{cacheBytes?: number, maxRows?: number, tolerant?: boolean} & import('./link.js').LinkOptions} [options]
   */
  constructor(module, url, post, options = {}) {
    this.module = module;
    this.url = url;
    this.post = post;
    this.options = options;
    this.link = new Link(url, options);
    this.spans = new Spans([]);
    /** @type {import('./playlist.js').Playlist} */
    this.playlist = {members: [], complete: false, targetDuration: 1};
    /** @type {Map<number, Part>} */
    this.parts = new Map();
    /** @type {Stage[]} that are wanted, the first shows the instant */
    this.stages = [];
    /** @type {Set<Part>} of the stages that have begun */
    this.active = new Set();
    /** @type {Goal | null} */
    this.goal = null;
    this.begun = 1;  // how many of the stages
    this.seeks = 0;
    this.uses = 0;
    this.transfers = /** @type {[number, number, number, number][]} */ ([]);
    this.closed = {bytes: 0, requests: 0, decodeSeconds: 0, lost: 0};
    this.mostRows = options.maxRows ?? 2 ** 21;
    this.isStated = false;  // does `info` have the presentation of a media member?
    this.lastProgress = 0;
    this.disposed = false;
    this.control = new AbortController();
    // Set by open().
    this.instance = /** @type {WebAssembly.Instance} */ (/** @type {unknown} */ (null));
    this.info = /** @type {import('./session.js').MovieInfo} */ (/** @type {unknown} */ (null));
    this.host = {
      options, instance: this.instance,
      link: this.link,
      receive: (/** @type {Part} */ part, /** @type {any} */ message, /** @type {Transferable[]} */ transfer = []) =>
        this.#receive(part, message, transfer),
      room: (/** @type {Part} */ part, /** @type {number} */ rows) => this.#room(part, rows),
      transferred: (/** @type {[number, number, number, number]} */ ...transfer) => this.#transferred(transfer),
      changed: () => {
        this.#advance(false);
        if ([...this.active].every(part => part.isIdle)) this.#progress(true);
      }
    };
  }

  /** @param {AbortSignal} [signal] */
  async open(signal = this.control.signal) {
    const [module] = await Promise.all([this.module, this.#firstPlaylist(signal)]);
    this.host.instance = this.instance = await instantiate(module);
    this.#span();
    await this.#openFirst(signal);
    if (!this.playlist.complete) void this.#follow();
    return {...this.info, playlist: {members: this.playlist.members, live: !this.playlist.complete, startTime: this.startTime}};
  }

  /** Opens what is shown first. What is lost is passed over. @param {AbortSignal} signal */
  async #openFirst(signal) {
    const {media} = this.spans;
    const first = this.spans.indexAt(this.startTime);
    const absent = new Set();  // addresses
    /** @type {L4DError | null} */
    let damage = null;
    for (let k = first, tries = 0; k < media.length && tries < mostStages; ++k) {
      const members = this.spans.with(media[k]);
      if (members.every(({url}) => absent.has(url))) continue;
      ++tries;
      const parts = members.map(entry => this.#part(entry));
      await Promise.all(parts.map(part => part.open(signal)));
      for (const part of parts) await this.#open(part, signal);
      if (k > first) this.firstTime = media[k].begin;
      if (this.info) return;
      for (const part of parts) {
        damage ??= part.damage;
        if (part.isAbsent) absent.add(part.entry.url);
      }
    }
    throw damage;
  }

  /**
   * Where playing begins: where the first member is that can be shown; of a file that grows, as late as two segments
   * before the end allow.
   */
  get startTime() {
    const {begin, end} = this.spans;
    const from = Math.max(begin, this.firstTime);
    return this.playlist.complete ? from : Math.max(from, end - 2 * this.playlist.targetDuration);
  }
  firstTime = -Infinity;

  dispose() {
    this.disposed = true;
    this.control.abort();
    for (const part of this.parts.values()) part.close();
    this.parts.clear();
    this.active.clear();
  }

  /** As that of a session. @param {Goal} goal @param {boolean} seek */
  want(goal, seek) {
    if (seek) ++this.seeks;
    this.goal = goal;
    this.begun = 1;
    for (const part of this.parts.values()) {
      part.hasFailed = false;
      if (seek) part.retry();
    }
    const {begin, end} = this.spans;
    const from = Math.min(Math.max(goal.time, begin), end);
    this.stages = this.#stagesOf(from, Math.min(from + goal.ahead, end));
    this.#advance(seek);
  }

  refresh() {
    this.lastReady = '';
    for (const part of this.parts.values()) {
      if (!this.active.has(part)) {
        part.drop();
      } else if (part.session.held.size > 0) {
        part.ready = null;
        part.session.refresh();
      }
    }
  }

  /**
   * @param {number} time @param {{sh?: boolean, detail?: number, maxTier?: number}} options
   * @param {AbortSignal} signal
   */
  async slice(time, options, signal) {
    const shown = this.spans.shownAt(time);
    const slices = [];
    for (const part of shown.members.map(entry => this.#part(entry))) {
      part.lastUsed = ++this.uses;
      ++part.users;
      try {
        await this.#open(part, signal);
        if (!part.damage) slices.push(await part.session.slice(shown.time - part.entry.shift, options, signal));
      } finally {
        --part.users;
      }
    }
    this.#closeOthers();
    return joinSlices(slices);
  }

  statistics() {
    const sum = {...this.closed, rows: 0, throughput: 0, memoryBytes: /** @type {any} */ (this.instance)?.exports.memory.buffer.byteLength ?? 0};
    for (const {session} of this.parts.values()) {
      const one = session.statistics();
      for (const key of /** @type {const} */ (['bytes', 'requests', 'decodeSeconds', 'lost', 'rows'])) sum[key] += one[key];
      sum.throughput = Math.max(sum.throughput, one.throughput);
      sum.memoryBytes += session.store.bytes;
    }
    return sum;
  }

  /** As that of a session. @returns {[number, number][]} */
  buffered() {
    /** @type {[number, number][]} */
    const spans = [];
    const cells = 4;
    for (const part of [...this.parts.values()].filter(p => p.entry.isMedia).sort((a, b) => a.entry.begin - b.entry.begin)) {
      const {begin, end} = part.entry;
      const parts = this.spans.with(part.entry).map(entry => this.parts.get(entry.number));
      for (let k = 0; k < cells; ++k) {
        const [from, to] = [k, k + 1].map(i => begin + (end - begin) * i / cells);
        if (!parts.every(p => p?.isBuffered((from + to) / 2))) continue;
        const last = spans.at(-1);
        if (last && from - last[1] < slack) last[1] = to;
        else spans.push([from, to]);
      }
    }
    return spans;
  }

  // ---- the playlist

  /** @param {AbortSignal} signal */
  async #firstPlaylist(signal) {
    for (;;) {
      this.playlist = await loadPlaylist(this.url, this.link, signal);
      this.spans = new Spans(this.playlist.members);
      if (this.spans.media.length > 0) return;
      if (this.playlist.complete) throw new L4DError('PLAYLIST', `${this.url}: no media member`);
      await wait(500 * this.playlist.targetDuration, signal);
    }
  }

  /** Looks for what is appended until the end. */
  async #follow() {
    const {signal} = this.control;
    for (let failures = 0, factor = 1; !this.playlist.complete && !signal.aborted;) {
      try {
        await wait(1000 * factor * this.playlist.targetDuration, signal);
        const next = await loadPlaylist(this.url, this.link, signal);
        const members = appended(this.playlist, next);
        factor = members.length > 0 ? 1 : 0.5;
        failures = 0;
        if (members.length > 0 || next.complete) this.#grow(next, members);
      } catch (error) {
        const failure = /** @type {any} */ (error);
        if (failure?.name === 'AbortError') return;
        if (failure?.code === 'CHANGED' || ++failures >= mostFailures) {
          return this.post({type: 'error', error: L4DError.toData(error)});
        }
        this.options.onRetry?.(String(failure?.message ?? failure));
      }
    }
  }

  /** @param {import('./playlist.js').Playlist} next @param {Member[]} members that are new */
  #grow(next, members) {
    // What ended by six decimals may end where its successor begins now.
    const last = this.spans.media.at(-1);
    if (last) last.end = next.members.find(m => m.number === last.number)?.end ?? last.end;
    this.playlist = next;
    this.spans.add(members);
    this.#span();
    this.post({type: 'grown', members, live: !next.complete});
    // A playlist may be ahead of its files.
    for (const part of this.parts.values()) part.retry();
    if (this.goal) this.want(this.goal, false);
  }

  #span() {
    if (!this.info) return;
    this.info.timeBegin = this.spans.begin;
    this.info.duration = this.spans.end - this.spans.begin;
    this.info.numFrames = Math.round(this.info.duration * this.info.frameRate);
  }

  // ---- members

  /** @param {Member} entry */
  #part(entry) {
    let part = this.parts.get(entry.number);
    if (!part) this.parts.set(entry.number, part = new Part(entry, this.host));
    return part;
  }

  /** @param {Part} part @param {AbortSignal} [signal] */
  async #open(part, signal = this.control.signal) {
    if (part.isMet) return;
    await part.open(this.control.signal);
    if (signal.aborted) throw abortError();
    if (part.isMet) return;
    part.isMet = true;
    if (part.damage) this.#tellLoss(part);
    else if (part.info) this.#meet(part, part.info);
  }

  /** @param {Part} part that is lost */
  #tellLoss(part) {
    if (!part.damage || part.isTold) return;
    part.isTold = true;
    ++this.closed.lost;
    const {damage: {code, clause, offset}, entry: {number, begin, end}} = part;
    this.post({type: 'loss', losses: [{code, clause, offset, member: number, begin, end, detailOnly: false}]});
  }

  /** Takes in what a member that is open says of itself. @param {Part} part @param {import('./decoder.js').Info} info */
  #meet(part, info) {
    for (const transfer of this.transfers) part.session.decoder.addTransfer(...transfer);
    const {timeBegin, duration, numFrames, rateNumerator, rateDenominator} = info;
    this.post({type: 'stream', number: part.entry.number,
               timeline: {timeBegin, duration, numFrames, rateNumerator, rateDenominator}});
    const room = Math.min(this.mostRows, part.session.maxRows);
    const before = this.info;
    if (!before) {
      this.info = {...info, maxRows: room};
    } else {
      this.info = {...before, tools: before.tools | info.tools, shDegree: Math.max(before.shDegree, info.shDegree),
                   numLayers: Math.max(before.numLayers, info.numLayers), lastTier: Math.max(before.lastTier, info.lastTier)};
      // Of the file are those of a media member.
      if (!this.isStated && part.entry.isMedia) this.info.presentation = info.presentation;
      // Before the first picture all that it needs is met.
      if (!this.goal) {
        this.info.maxRows = Math.min(this.mostRows, before.maxRows + room);
        this.info.numGaussians += info.numGaussians;
      }
    }
    this.isStated ||= part.entry.isMedia;
    this.#span();
    if (before && this.goal) this.#tellInfo(before);
  }

  /** Tells of an info that is new where it matters to who draws. @param {import('./session.js').MovieInfo} before */
  #tellInfo(before) {
    const keys = /** @type {const} */ (['tools', 'shDegree', 'numLayers', 'lastTier', 'maxRows']);
    if (keys.some(key => before[key] !== this.info[key])) this.post({type: 'info', info: {...this.info}});
  }

  /** Makes room for rows of a member, by those of members that are not wanted now. @param {Part} part @param {number} more */
  #room(part, more) {
    let rows = more;
    for (const {session} of this.parts.values()) rows += session.heldRows;
    for (const other of this.#unused()) {
      if (rows <= this.info.maxRows) return;
      rows -= other.session.heldRows;
      if (other !== part) other.drop();
    }
    if (rows <= this.info.maxRows || this.info.maxRows >= this.mostRows) return;
    const before = this.info;
    this.info = {...before, maxRows: Math.min(this.mostRows, roundedRows(2 * rows))};
    this.#tellInfo(before);
  }

  /** Members that are not wanted, those not used for longest first. */
  #unused() {
    return [...this.parts.values()].filter(part => !this.active.has(part)).sort((a, b) => a.lastUsed - b.lastUsed);
  }

  #closeOthers() {
    const unused = this.#unused();
    const budget = this.options.cacheBytes ?? 256 * 2 ** 20;
    let bytes = 0;
    for (const {session} of this.parts.values()) bytes += session.store.bytes;
    for (let left = unused.length; left > 0 && (left > mostOpen || bytes > budget); --left) {
      const part = unused[unused.length - left];
      if (part.users > 0 || !part.isMet) continue;
      const {session} = part;
      bytes -= session.store.bytes;
      const one = session.statistics();
      for (const key of /** @type {const} */ (['bytes', 'requests', 'decodeSeconds', 'lost'])) this.closed[key] += one[key];
      part.drop();
      part.close();
      this.parts.delete(part.entry.number);
      this.post({type: 'closed', number: part.entry.number});
    }
  }

  // ---- what is wanted

  /** @param {number} from @param {number} to @returns {Stage[]} */
  #stagesOf(from, to) {
    const {media} = this.spans;
    /** @type {Stage[]} */
    const stages = [];
    for (let k = this.spans.indexAt(from); k < media.length && stages.length < mostStages; ++k) {
      if (stages.length > 0 && media[k].begin >= to) break;
      const {begin, end} = media[k];
      stages.push({media: media[k], members: this.spans.with(media[k]), begin: Math.min(Math.max(from, begin), end),
                   end: Math.max(Math.min(to, end), begin)});
    }
    return stages;
  }

  /**
   * Wants what comes first: a stage begins when the one before it is here.
   * @param {boolean} seek what is under way for another instant is cancelled
   */
  #advance(seek) {
    if (!this.goal || this.disposed) return;
    const {detail, maxLevel, maxTier, playing, rate} = this.goal;
    /** @type {Map<Part, {from: number, to: number, first: boolean}>} */
    const spans = new Map();
    let until = -Infinity;
    for (const [k, stage] of this.stages.entries()) {
      const parts = stage.members.map(entry => this.#part(entry));
      for (const part of parts) {
        const span = spans.get(part);
        if (span) span.to = stage.end;
        else spans.set(part, {from: stage.begin, to: stage.end, first: k === 0});
      }
      until = Math.min(...parts.map(part => part.until(stage.begin, this.seeks)));
      if (k + 1 < this.begun) continue;
      if (until < stage.end - slack || !playing && !parts.every(part => part.isIdle)) break;
      this.begun = k + 2;
    }
    for (const part of this.parts.values()) if (!spans.has(part)) part.rest();
    this.active = new Set(spans.keys());
    const ahead = Math.min(until, this.stages.at(-1)?.end ?? 0) - this.stages[0].begin;
    const wanted = (this.stages.at(-1)?.end ?? 0) - this.stages[0].begin;
    const most = playing && ahead < Math.min(leastAhead * Math.max(Math.abs(rate ?? 1), 1), wanted) - slack ? 0 : undefined;
    for (const [part, {from, to, first}] of spans) {
      part.lastUsed = ++this.uses;
      const goal = {time: from, ahead: to - from, detail, maxLevel, maxTier, playing: playing || !first, rate, most, id: this.seeks};
      if (part.hasFailed || part.damage) continue;
      if (part.info && part.isMet) part.want(goal, seek && first);
      else void this.#openAndGoOn(part);
    }
    this.#closeOthers();
    this.#ready();
  }

  /** @param {Part} part */
  async #openAndGoOn(part) {
    if (part.opening) return;
    const {seeks} = this;
    try {
      await this.#open(part);
    } catch (error) {
      if (this.disposed || /** @type {any} */ (error)?.name === 'AbortError') return;
      // A seek since then has not been tried.
      if (seeks === this.seeks) {
        part.hasFailed = true;
        return this.post({type: 'error', error: L4DError.toData(error), id: this.goal?.id, turn: this.goal?.turn});
      }
    }
    this.#advance(false);
  }

  /** Says how much of the instant is here, and until when the lowest rung is. */
  #ready() {
    const {goal, stages: [first]} = this;
    if (!goal || !first) return;
    const parts = first.members.map(entry => this.#part(entry));
    let until = -Infinity;
    for (const stage of this.stages) {
      const to = Math.min(...stage.members.map(entry => this.#part(entry).until(stage.begin, this.seeks)));
      if (to < stage.begin - slack) break;
      until = Math.min(to, stage.end);
      if (until < stage.end - slack) break;
      // Between spans, what is there is shown, and then what comes next.
      if (stage === this.stages.at(-1)) until = Math.min(Math.max(goal.time + goal.ahead, until), this.spans.end);
    }
    if (until === -Infinity) return;
    const tier = Math.min(this.info.lastTier, goal.maxTier ?? Infinity, ...parts.map(part => part.tier));
    const isFull = parts.every(part => part.damage || part.ready.detail === 'full');
    const from = Math.min(Math.max(goal.time, this.spans.begin), this.spans.end);
    const message = {type: 'ready', id: goal.id, turn: goal.turn, from, until: Math.max(until, from), tier,
                     detail: isFull ? 'full' : 'base'};
    const text = JSON.stringify(message);
    if (text === this.lastReady) return;
    this.lastReady = text;
    this.post(message);
  }
  lastReady = '';

  // ---- what sessions say

  /** @param {Part} part @param {any} message @param {Transferable[]} transfer */
  #receive(part, message, transfer) {
    const {number} = part.entry;
    if (message.type === 'rows') {
      const degree = this.info.shDegree;
      const {sh, shStride} = widenHarmonics(message, degree);
      const rows = {...message, key: `${number}:${message.key}`, stream: number, sh, shStride};
      this.post(rows, [message.geometry.buffer, sh.buffer]);
    } else if (message.type === 'removed') {
      this.post({type: 'removed', key: `${number}:${message.key}`});
    } else if (message.type === 'ready') {
      part.ready = message;
      this.#advance(false);
    } else if (message.type === 'progress') {
      this.#progress();
    } else if (message.type === 'loss') {
      this.post({...message, losses: message.losses.map((/** @type {any} */ l) => ({...l, member: number}))});
    } else if (message.type === 'error' && part.lose(L4DError.fromData(message.error))) {
      this.#tellLoss(part);
      this.#advance(false);
    } else if (message.type === 'error') {
      // Until somebody wants something again.
      part.hasFailed = true;
      part.wanted = '';
      this.post({...message, id: this.goal?.id, turn: this.goal?.turn});
    } else {
      this.post(message, transfer);
    }
  }

  /** Reports what has come, at most five times a second. */
  #progress(always = false) {
    const now = performance.now();
    if (!always && now - this.lastProgress < 200) return;
    this.lastProgress = now;
    this.post({type: 'progress', ...this.statistics(), buffered: this.buffered()});
  }

  /** @param {[number, number, number, number]} transfer */
  #transferred(transfer) {
    this.transfers = [...this.transfers, transfer].slice(-mostTransfers);
    for (const {session} of this.parts.values()) session.decoder?.addTransfer(...transfer);
  }
}

/** Waits, and fails as soon as the signal aborts. @param {number} ms @param {AbortSignal} signal */
const wait = (ms, signal) => new Promise((resolve, reject) => {
  if (signal.aborted) return reject(abortError());
  const timer = setTimeout(resolve, ms);
  signal.addEventListener('abort', () => { clearTimeout(timer); reject(abortError()); }, {once: true});
});
