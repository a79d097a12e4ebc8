// SPDX-License-Identifier: Apache-2.0
// What <l4d-player> has in common with the media elements of HTML.

const Base = globalThis.HTMLElement ?? /** @type {any} */ (class {});
const own = ['src', 'loop', 'autoplay', 'currentTime', 'playbackRate'];

/**
 * Properties and methods of HTMLMediaElement. `src`, `loop` and `autoplay` reflect attributes. Times are seconds from the
 * beginning of the scene, as the timeline shows them; `movie.currentTime` is in the time of the stream.
 */
export class MediaElement extends Base {
  constructor() {
    super();
    /** @type {import('l4dcodec').Movie | null} */
    this.movie = null;
    /** What load() has begun last. @type {Promise<void> | null} */
    this.opening = null;
    this.isOpen = false;  // with a first picture
    /** Seconds at which the next scene begins, where the page says so. @type {number | null} */
    this.startAt = null;
    this.rateWanted = 1;
    this.plays = 0;  // counts play() and pause()
  }

  /** @param {boolean} isOpen is the first picture there? */
  setOpen(isOpen) {
    this.isOpen = isOpen;
    if (isOpen) this.startAt = null;
  }

  /** A page may have set properties before the element was defined: they would hide those of the class. */
  upgradeProperties() {
    const self = /** @type {any} */ (this);
    for (const name of own) {
      if (!Object.hasOwn(self, name)) continue;
      const value = self[name];
      delete self[name];
      self[name] = value;
    }
  }

  /** The address, absolute; '' where there is none. */
  get src() {
    const source = this.getAttribute('src') ?? '';
    return source && URL.canParse(source, document.baseURI) ? new URL(source, document.baseURI).href : source;
  }
  set src(source) { this.setAttribute('src', String(source)); }
  get loop() { return this.hasAttribute('loop'); }
  set loop(on) { this.toggleAttribute('loop', Boolean(on)); }
  get autoplay() { return this.hasAttribute('autoplay'); }
  set autoplay(on) { this.toggleAttribute('autoplay', Boolean(on)); }

  get currentTime() { return this.movie ? this.movie.currentTime - this.movie.timeBegin : this.startAt ?? 0; }
  set currentTime(time) {
    if (!Number.isFinite(time)) throw new TypeError(`a time is a finite number of seconds, not ${time}`);
    if (!this.isOpen) this.startAt = time;
    if (this.movie) void this.movie.seek(this.movie.timeBegin + time).catch(() => {});
  }
  /** NaN: nothing is open. Infinity: it is still being recorded. */
  get duration() { return !this.movie ? NaN : this.movie.live ? Infinity : this.movie.duration; }
  get paused() { return this.movie?.paused ?? true; }
  get ended() {
    const {movie} = this;
    return movie !== null && movie.paused && !movie.live && movie.currentTime >= movie.timeEnd;
  }
  get playbackRate() { return this.rateWanted; }
  set playbackRate(rate) {
    if (!Number.isFinite(rate)) throw new TypeError(`a rate is a finite number, not ${rate}`);
    if (rate === this.rateWanted) return;
    this.rateWanted = rate;
    if (this.movie) this.movie.rate = rate;
    this.dispatchEvent(new Event('ratechange'));
  }

  /** Plays as soon as what load() has begun is open. Fails as load() does, and with AbortError where pause() comes first. */
  async play() {
    const plays = ++this.plays;
    await this.opening;
    if (plays !== this.plays) throw new DOMException('another play() or pause() came first', 'AbortError');
    if (!this.movie) throw new DOMException('no scene is open', 'InvalidStateError');
    this.movie.play();
  }

  pause() {
    ++this.plays;
    this.movie?.pause();
  }
}
