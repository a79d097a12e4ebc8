// SPDX-License-Identifier: Apache-2.0
// What <l4d-player> has in common with the media elements of HTML.

const Base = globalThis.HTMLElement ?? /** @type {any} */ (class {});
const own = ['src', 'loop', 'autoplay', 'controls', 'poster', 'preload', 'currentTime', 'playbackRate', 'muted', 'volume'];

/** Spans of time, as media elements have them. */
class Ranges {
  /** @param {[number, number][]} spans */
  constructor(spans) { this.spans = spans; }
  get length() { return this.spans.length; }
  /** @param {number} k */
  start(k) { return this.#at(k)[0]; }
  /** @param {number} k */
  end(k) { return this.#at(k)[1]; }
  /** @param {number} k */
  #at(k) {
    if (!this.spans[k]) throw new DOMException(`there is no span ${k}`, 'IndexSizeError');
    return this.spans[k];
  }
}

/** @type {Record<string, number>} of MediaError; others are 4: the source is not supported */
const errorCodes = {NETWORK: 2, CHANGED: 2, CORRUPT: 3, CHECKSUM: 3, TRUNCATED: 3, INTERNAL: 3};

/**
 * Properties, methods and events of HTMLMediaElement. `src`, `loop`, `autoplay`, `poster` and `preload` reflect attributes. Times are
 * seconds from the beginning of the scene, as the timeline shows them; `movie.currentTime` is in the time of the stream.
 */
export class MediaElement extends Base {
  constructor() {
    super();
    /** @type {import('l4dcodec').Movie | null} */
    this.movie = null;
    /** What load() has begun last. @type {Promise<void> | null} */
    this.opening = null;
    this.isOpen = false;     // with a first picture
    this.isWaiting = false;  // it plays, and what comes next is not here
    this.seeks = 0;          // under way
    /** @type {{code: number, message: string, cause: any} | null} why nothing plays; the cause is an L4DError */
    this.error = null;
    /** While it waits behind its metadata until pictures are wanted: they are. @type {(() => void) | null} */
    this.wake = null;
    /** Seconds at which the next scene begins, where the page says so. @type {number | null} */
    this.startAt = null;
    this.rateWanted = 1;
    this.plays = 0;  // counts play() and pause()
    /** What open() takes besides what attributes say. @type {import('l4dcodec').OpenOptions} */
    this.options = /** @type {any} */ (this).options ?? {};  // before the element was defined
    /** Of sync(). @type {HTMLMediaElement | null} */
    this.audio = null;
    this.sound = {muted: false, volume: 1};
  }

  /** @param {string} type of an event without a detail */
  tell(type) { this.dispatchEvent(new Event(type)); }

  /** @param {boolean} isOpen is the first picture there? */
  setOpen(isOpen) {
    this.isOpen = isOpen;
    if (isOpen) this.startAt = null;
  }

  /** @param {any} error an L4DError, or null */
  setError(error) {
    this.error = error && {code: errorCodes[error.code] ?? 4, message: String(error.message ?? error), cause: error};
  }

  /** Tells of what a movie does as of media. @param {import('l4dcodec').Movie} movie */
  follow(movie) {
    const pass = (/** @type {string} */ type, event = type) => movie.on(type, () => this.tell(event));
    pass('time', 'timeupdate');
    for (const type of ['progress', 'pause', 'ended']) pass(type);
    pass('grown', 'durationchange');
    pass('retry', 'stalled');
    movie.on('play', () => {
      this.tell('play');
      if (!this.isWaiting) this.tell('playing');
    });
    movie.on('stall', () => {
      this.isWaiting = true;
      this.tell('waiting');
    });
    movie.on('resume', () => {
      this.isWaiting = false;
      if (!movie.paused) this.tell('playing');
    });
    if (this.audio) movie.sync(this.audio);
  }

  /** A page may have set properties before the element was defined: they would hide those of the class. @param {string[]} more */
  upgradeProperties(more) {
    const self = /** @type {any} */ (this);
    for (const name of [...own, ...more]) {
      if (!Object.hasOwn(self, name)) continue;
      const value = self[name];
      delete self[name];
      self[name] = value;
    }
  }

  /** The address, absolute; '' where there is none. */
  get src() { return this.#address('src'); }
  set src(source) { this.setAttribute('src', String(source)); }
  get currentSrc() { return this.movie ? this.src : ''; }
  get poster() { return this.#address('poster'); }
  set poster(address) { this.setAttribute('poster', String(address)); }
  get loop() { return this.hasAttribute('loop'); }
  set loop(on) { this.toggleAttribute('loop', Boolean(on)); }
  get autoplay() { return this.hasAttribute('autoplay'); }
  set autoplay(on) { this.toggleAttribute('autoplay', Boolean(on)); }
  /** Whether it shows its own, which the attribute controls="none" takes away. */
  get controls() { return this.getAttribute('controls') !== 'none'; }
  set controls(on) {
    if (on) this.removeAttribute('controls');
    else this.setAttribute('controls', 'none');
  }
  /** 'none': nothing is fetched before play(); 'metadata': no pictures before that, or before it is seen. @returns {string} */
  get preload() { return ['none', 'metadata'].find(preload => preload === this.getAttribute('preload')) ?? 'auto'; }
  set preload(preload) { this.setAttribute('preload', String(preload)); }

  /** @param {string} name */
  #address(name) {
    const address = this.getAttribute(name) ?? '';
    return address && URL.canParse(address, document.baseURI) ? new URL(address, document.baseURI).href : address;
  }

  get currentTime() { return this.startAt ?? (this.movie ? this.movie.currentTime - this.movie.timeBegin : 0); }
  set currentTime(time) {
    if (!Number.isFinite(time)) throw new TypeError(`a time is a finite number of seconds, not ${time}`);
    if (!this.isOpen) this.startAt = time;
    if (this.movie) this.seekTo(this.movie.timeBegin + time);
  }

  /** @param {number} time of the stream @param {number} [tolerance] as of Movie.seek() */
  seekTo(time, tolerance) {
    const {movie} = this;
    if (!movie) return;
    const isLast = (seeks => () => movie === this.movie && seeks === this.seeks)(++this.seeks);
    this.tell('seeking');
    const ended = (/** @type {boolean} */ isShown) => {
      if (!isLast()) return;
      this.seeks = 0;
      if (isShown) for (const type of ['timeupdate', 'seeked']) this.tell(type);
    };
    if (this.wake) {
      this.startAt = time - movie.timeBegin;
      this.wake();
      this.opening?.then(() => ended(true), () => ended(false));
    } else {
      movie.seek(time, {tolerance}).then(() => ended(true), () => ended(false));
    }
  }

  get seeking() { return this.seeks > 0; }
  get seekable() {
    const {movie} = this;
    return new Ranges(movie ? [[0, movie.duration]] : []);
  }
  get buffered() {
    const begin = this.movie?.timeBegin ?? 0;
    return new Ranges((this.movie?.buffered ?? []).map(([from, to]) => [from - begin, to - begin]));
  }
  /** HAVE_NOTHING to HAVE_ENOUGH_DATA: 0, 1, 2, 3, 4 */
  get readyState() {
    const {movie} = this;
    if (!movie) return 0;
    if (!this.isOpen || this.seeking) return 1;
    if (this.isWaiting) return 2;
    return movie.secondsAhead > 2 || movie.ready.until >= movie.timeEnd - 1e-3 ? 4 : 3;
  }
  /** NETWORK_EMPTY, NETWORK_IDLE, NETWORK_LOADING, NETWORK_NO_SOURCE: 0, 1, 2, 3 */
  get networkState() {
    const {movie} = this;
    if (movie) return this.isWaiting || this.seeking || !this.isOpen && !this.wake ? 2 : 1;
    return this.error ? 3 : this.opening ? 2 : 0;
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
    this.tell('ratechange');
  }

  /** Takes the time from an audio or video element, whose sound `muted` and `volume` are of. @param {HTMLMediaElement | null} media */
  sync(media) {
    this.audio = media;
    this.movie?.sync(media);
    if (media) Object.assign(media, this.sound);
  }
  get muted() { return this.sound.muted; }
  set muted(muted) { this.#setSound({muted: Boolean(muted)}); }
  get volume() { return this.sound.volume; }
  set volume(volume) {
    if (!(volume >= 0 && volume <= 1)) throw new DOMException(`a volume is from 0 to 1, not ${volume}`, 'IndexSizeError');
    this.#setSound({volume});
  }
  /** @param {{muted?: boolean, volume?: number}} sound */
  #setSound(sound) {
    const before = this.sound;
    this.sound = {...before, ...sound};
    if (this.sound.muted === before.muted && this.sound.volume === before.volume) return;
    if (this.audio) Object.assign(this.audio, this.sound);
    this.tell('volumechange');
  }

  /** Opens `src`, of the element. @returns {Promise<void>} */
  load() { return Promise.reject(new DOMException('nothing to load', 'NotSupportedError')); }

  /** Plays as soon as what load() has begun is open. Fails as load() does, and with AbortError where pause() comes first. */
  async play() {
    const plays = ++this.plays;
    if (!this.opening && this.getAttribute('src')) void this.load();
    this.wake?.();
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
