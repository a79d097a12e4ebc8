// SPDX-License-Identifier: Apache-2.0
import {L4DError, open} from 'l4dcodec';
import {isStill} from './aim.js';
import {openOptions} from './attributes.js';
import {Captions} from './captions.js';
import {CameraElement, cameraAttributes, cameraProperties} from './camera-element.js';
import {PointerControls} from './controls.js';
import {enter, hasRoom, leave} from './crowd.js';
import {Hotspots} from './hotspots.js';
import {onKey} from './keys.js';
import {canvasOf} from './picture.js';
import {hasPictureInPicture} from './pip.js';
import {Preview} from './preview.js';
import {watchFile} from './reload.js';
import {fill} from './template.js';
import {clockText, describeError, describeLosses, overlayLines, parseLink, spokenTime} from './text.js';
import {View} from './view.js';
import {addWords, changes, languageOf, Texts, watchLanguage, words} from './words.js';

const idleSeconds = 2.5;
const scrubSteps = 500;  // of the timeline, while it is dragged
const lostSeconds = 3;  // that a context may be lost, before the player gives it up
/** A page may have few contexts, and one lives until its canvas is collected. @param {WebGL2RenderingContext | null | undefined} gl */
const giveBack = gl => gl?.getExtension('WEBGL_lose_context')?.loseContext();
const playbacks = /** @type {const} */ (['once', 'loop', 'ping-pong']);

/**
 * `<l4d-player src poster autoplay loop preload="none|metadata" loading="lazy" controls="none" playback="once|loop|ping-pong|auto"
 * camera="orbit|fly" gestures="all|page|none" detail="auto|base|full" backend="auto|webgl2|webgpu" reload="SECONDS" overlay lang>`, and what
 * attributes.js and camera-element.js read: a player with controls. Events: 'open' (the movie is its detail), 'error' (an Error),
 * 'backend' (which one draws), 'camera-change', and those of media elements. `movie` and `view` are those of the packages.
 */
export class L4DPlayer extends CameraElement {
  static observedAttributes = ['src', 'poster', 'loop', 'playback', 'detail', 'camera', 'overlay', 'gestures', ...cameraAttributes];

  /** Texts by language. Setting it adds texts or replaces them, and players show them at once. */
  static get words() { return words; }
  static set words(more) { addWords(more); }

  constructor() {
    super();
    const root = this.attachShadow({mode: 'open'});
    fill(root);
    /** @type {(selector: string) => any} */
    this.$ = selector => root.querySelector(selector);
    this.texts = new Texts('en');
    this.hotspots = new Hotspots(this, this.$('.spots'));
    this.captions = new Captions(this);
    this.preview = new Preview(this);
    this.loading = new AbortController();
    /** What load() was given last. @type {Parameters<typeof open>[0] | undefined} */
    this.source = undefined;
    /** Who looks for another version of it. @type {object | null} */
    this.watching = null;
    /** While it is in a page. @type {AbortController | null} */
    this.life = null;
    /** Of before it gave its context back, or left the page. @type {{camera: string, plays: boolean} | null} */
    this.kept = null;
    this.frames = {count: 0, since: performance.now(), fps: 0};
    this.scrubbing = false;
    this.scrubbed = 0;
    this.#listen();
  }

  connectedCallback() {
    this.#speak();
    watchLanguage(this, this.languages);
    if (this.life) return;  // it was moved
    this.life = new AbortController();
    this.#turn();
    const {signal} = this.life;
    changes.addEventListener('change', () => this.#speak(), {signal});
    globalThis.addEventListener('languagechange', () => this.#speak(), {signal});
    this.upgradeProperties(cameraProperties);
    this.hotspots.read();
    this.captions.read();
    this.captions.rest(false);
    document.addEventListener('visibilitychange', () => this.#hide(document.hidden), {signal});
    const observer = new IntersectionObserver(entries => this.#near(entries.at(-1)?.isIntersecting ?? true), {rootMargin: '100%'});
    observer.observe(this);
    const timer = setInterval(() => this.#everySecond(), 500);
    signal.addEventListener('abort', () => {
      observer.disconnect();
      this.languages.disconnect();
      clearInterval(timer);
    });
    const {movie} = this;
    // Opened before the element was in a page.
    if (movie) void this.#setView().then(() => this.view?.show(movie)).then(() => this.aim.home()).catch(error => this.#showError(error));
    else this.#begins();
  }

  disconnectedCallback() {
    // Who moves it adds it again at once.
    queueMicrotask(() => {
      if (this.isConnected || !this.life) return;
      this.life.abort();
      this.life = null;
      this.captions.rest(true);
      this.#keep();
      this.unload();
      this.#dropView();
    });
  }

  /** @param {string} name @param {string | null} before @param {string | null} value */
  attributeChangedCallback(name, before, value) {
    // Before it is in a page, connectedCallback is still to come, and loads it.
    if (name === 'src' && value && value !== before && this.life) {
      this.kept = null;
      this.unload();
      this.#begins();
    }
    if (name === 'poster') {
      this.$('.poster').hidden = !value;
      this.$('.poster').src = value ?? '';
    }
    if (name === 'loop' || name === 'playback') this.#setPlayback();
    if (name === 'detail' && value) this.#setDetail(value);
    if (name === 'camera') this.#setMode(value === 'fly' ? 'fly' : 'orbit');
    if (name === 'overlay') this.toggleOverlay(value !== null);
    if (name === 'gestures') this.#scrolls();
    if (cameraAttributes.includes(name) && value !== before) this.aim.update(name);
  }

  /** Loads `src`, unless the page, or its other players, want that later: then a click does it. */
  #begins() {
    const source = this.kept ? this.source : this.getAttribute('src');
    if (!source || this.opening || !this.life) return;
    this.isLazy = this.preload !== 'none' || this.autoplay;
    if (this.isLazy && this.getAttribute('loading') !== 'lazy' && (this.#isForMetadata || hasRoom())) return void this.#open(source);
    this.$('.big').hidden = false;
  }

  /** Whether what it loads by itself ends behind the metadata. */
  get #isForMetadata() { return this.preload === 'metadata' && !this.autoplay && !this.kept; }

  /** @param {boolean} isNear */
  #near(isNear) {
    this.near = isNear;
    this.#scrolls();
    const source = this.#again();
    if (isNear && !this.opening && (this.isLazy || this.kept) && source && (this.#isForMetadata || hasRoom())) void this.#open(source);
  }

  /** What a click, or being seen, loads. */
  #again() { return (this.kept ? this.source : undefined) ?? this.getAttribute('src') ?? undefined; }

  /** @param {boolean} hidden */
  #hide(hidden) {
    const {movie} = this;
    if (hidden && movie && !movie.paused) {
      movie.pause();
      this.resumes = this.plays;
    } else if (!hidden && movie?.paused && this.resumes === this.plays) {
      movie.play();
    }
    if (!hidden) this.resumes = -1;
  }
  resumes = -1;  // with so many calls of play() and pause()

  /** What is to be the same when it loads again. */
  #keep() {
    if (!this.movie || !this.isOpen) return;
    this.kept = {camera: String(this.view?.orbit), plays: !this.movie.paused};
    this.startAt = this.currentTime;
  }

  /** Gives its context to others. Time, camera and picture stay; it loads again when it is seen or used. */
  async sleep() {
    leave(this);
    const {signal} = this.loading;
    const {view} = this;
    const late = new Promise(resolve => setTimeout(resolve, 2000, null));
    const pixels = this.isOpen && view?.gl?.isContextLost() === false ? await Promise.race([view.pixels().catch(() => null), late]) : null;
    if (signal.aborted || this.view !== view) return;
    if (pixels && view) {
      const {width, height} = view.canvas;
      this.$('canvas').after(Object.assign(canvasOf(pixels, width, height), {className: 'still'}));
    }
    this.#keep();
    this.unload();
    this.#dropView();
    this.$('.big').hidden = false;
  }

  #dropView() {
    leave(this);
    this.pip.leave();
    this.pointer?.dispose();
    const gl = this.view?.gl;
    this.view?.dispose();
    Object.assign(this, {view: null, pointer: null});
    // The next view has another canvas.
    const canvas = this.$('canvas');
    canvas.replaceWith(canvas.cloneNode());
    giveBack(gl);
  }

  /** Fails where nothing can draw. */
  async #setView() {
    enter(this);
    const {view: present} = this;
    if (present) return void await present.ready;
    const canvas = this.$('canvas');
    try {
      const backend = /** @type {any} */ (this.getAttribute('backend') ?? 'auto');
      const view = new View(canvas, {background: [0.043, 0.051, 0.063], backend});
      this.view = view;
      this.pointer = new PointerControls(canvas, view.orbit, () => { this.steered(); this.#awake(); }, () => this.toggle(),
                                         event => this.#takes(event), event => void this.lookAtPoint(event.clientX, event.clientY));
      view.ondraw = () => { this.hotspots.place(); this.drawn(); };
      this.#setMode(this.getAttribute('camera') === 'fly' ? 'fly' : 'orbit');
      const detail = await view.ready;
      // It was removed before it was known what draws; what drew by WebGPU has no such context.
      if (this.view !== view) return giveBack(canvas.getContext('webgl2'));
      this.dispatchEvent(new CustomEvent('backend', {detail}));
      this.removeAttribute('unsupported');
      const givesUp = () => { if (this.view === view && view.gl?.isContextLost()) void this.sleep(); };
      // A context that #dropView gave back is lost on purpose: a timer would keep the player in memory.
      canvas.addEventListener('webglcontextlost', () => { if (this.view === view) setTimeout(givesUp, 1000 * lostSeconds); });
    } catch (error) {
      this.#dropView();
      this.toggleAttribute('unsupported', true);
      throw error;
    }
  }

  /**
   * Opens a file and shows it; without one, that of `src`. Resolves when its first picture is there, and fails as open()
   * does; the player shows why.
   * @param {string | URL | Blob | ArrayBuffer | ArrayBufferView} [source] @returns {Promise<void>}
   */
  load(source = this.getAttribute('src') ?? '') { return this.#open(source, false); }

  /** @param {Parameters<typeof open>[0]} source @param {boolean} [isForMetadata] waits behind them until pictures are wanted */
  #open(source, isForMetadata = this.#isForMetadata) {
    if (source !== this.source) this.kept = null;
    this.unload();
    this.source = source;
    const opening = this.opening = this.#load(source, this.loading.signal, isForMetadata);
    opening.catch(() => {});  // shown, even if nobody waits for it
    return opening;
  }

  /** @param {Parameters<typeof open>[0]} source @param {AbortSignal} signal @param {boolean} isForMetadata */
  async #load(source, signal, isForMetadata) {
    this.setError(null);
    this.isLazy = false;
    this.$('.message').hidden = true;
    this.#busy(true);
    this.tell('loadstart');
    try {
      if (source === '') throw new L4DError('INVALID_ARGUMENT', 'the player has no src');
      if (typeof source === 'string' && this.hasAttribute('reload')) void watchFile(this, source);
      // What cannot be drawn is not fetched.
      if (this.life && !isForMetadata) await this.#setView();
      signal.throwIfAborted();
      const movie = await open(source, {...openOptions(this), signal, ...isForMetadata && {preload: 'metadata'}});
      if (signal.aborted) movie.dispose();
      signal.throwIfAborted();
      this.movie = movie;
      this.#meet(movie);
      if (isForMetadata) {
        await this.#wanted();
        signal.throwIfAborted();
        this.$('.big').hidden = true;
        this.#busy(true);
        if (this.life) await this.#setView();
        signal.throwIfAborted();
      }
      await this.#begin(movie);
      signal.throwIfAborted();
      if (this.movie !== movie) throw this.error?.cause;
    } catch (error) {
      if (!signal.aborted) this.#showError(error);
      throw error;
    }
  }

  /** Resolves when somebody plays, seeks or sees it, or it ends. */
  async #wanted() {
    this.#busy(false);
    this.$('.big').hidden = false;
    const seen = new IntersectionObserver(entries => { if (entries.at(-1)?.isIntersecting && hasRoom()) this.wake?.(); });
    seen.observe(this);
    await new Promise(resolve => { this.wake = () => resolve(undefined); });
    this.wake = null;
    seen.disconnect();
  }

  /** Follows what has metadata by now. @param {import('l4dcodec').Movie} movie */
  #meet(movie) {
    this.#setPlayback();
    movie.rate = this.rateWanted;
    movie.on('time', () => this.#showTime());
    movie.on('progress', () => this.#showProgress());
    for (const type of ['play', 'pause', 'ended']) movie.on(type, () => this.#showState(type));
    movie.on('stall', () => this.#busy(true));
    movie.on('resume', () => this.#busy(false));
    movie.on('ready', () => this.#busy(false));
    movie.on('error', error => this.#showError(error));
    movie.on('grown', ({live}) => {
      this.#showEnd(movie);
      if (!live) this.#say('complete');
    });
    movie.on('live', ({state}) => {
      if (state === 'stale' || state === 'restarted') this.#say(state);
    });
    movie.on('retry', () => this.#say('slowLink'));
    this.follow(movie);
    for (const type of ['durationchange', 'loadedmetadata']) this.tell(type);
    this.#fillMenu(movie);
    movie.on('loss', () => this.#showLosses(movie));
    this.#showLosses(movie);
  }

  /** Shows the first picture. @param {import('l4dcodec').Movie} movie */
  async #begin(movie) {
    await this.view?.show(movie);
    const link = this.#linkOfPage();
    const start = this.startAt === null ? movie.startTime : movie.timeBegin + this.startAt;
    await movie.seek(this.kept ? start : link.time ?? start).catch(error => {
      // Who seeks meanwhile knows better.
      if (error.name !== 'AbortError') throw error;
    });
    if (this.movie !== movie) return;
    await this.aim.home();
    const camera = this.kept?.camera ?? link.camera;
    if (camera && this.view?.orbit.parse(camera)) this.aim.steer({});
    this.aim.jump();
    await this.view?.settled();
    if (this.movie !== movie) return;
    this.setOpen(true);
    this.$('.poster').classList.add('gone');
    this.$('.still')?.remove();
    this.#busy(false);
    this.#showTime();
    this.#showProgress();
    for (const type of ['loadeddata', 'canplay', 'canplaythrough']) this.tell(type);
    if (this.kept ? this.kept.plays : this.autoplay && !isStill()) movie.play();
    else this.$('.big').hidden = false;
    this.kept = null;
    this.#say('ready', {what: movie.live ? this.texts.say('live') : spokenTime(movie.duration, this.texts)});
    this.dispatchEvent(new CustomEvent('open', {detail: movie}));
  }

  unload() {
    const wasLoading = this.opening && !this.isOpen && !this.error;
    const had = this.movie;
    this.opening = null;
    this.setOpen(false);
    this.isWaiting = false;
    this.seeks = 0;
    this.loading.abort();
    this.wake?.();
    this.loading = new AbortController();
    this.view?.hide();
    this.aim.end();
    if (!this.kept) this.hotspots.hide();
    this.movie?.dispose();
    this.movie = null;
    this.captions.show();
    this.$('.big').hidden = true;
    this.$('.poster').classList.remove('gone');
    if (wasLoading) this.tell('abort');
    if (had || wasLoading) this.tell('emptied');
  }

  toggle() {
    if (!this.movie && !this.opening && this.#again() !== undefined) void this.load(this.#again());
    if (!this.movie || this.wake) return void this.play().catch(() => {});
    if (this.movie.paused) this.movie.play();
    else this.movie.pause();
  }

  /** @param {number} time @param {number} [tolerance] as of Movie.seek() */
  seek(time, tolerance) {
    if (!this.movie) return;
    if (time > this.movie.timeEnd && this.movie.loop) time = this.movie.timeBegin;
    this.seekTo(time, tolerance);
    this.#awake();
  }

  /** @param {number} rate */
  setRate(rate) {
    this.playbackRate = Math.min(Math.max(rate, 0.25), 4);
    this.#say('rate', {rate: this.texts.number(this.playbackRate)});
  }

  /** Resolves when the first view is back. */
  home() { return this.aim.home(); }

  toggleFullscreen() {
    if (document.fullscreenElement === this) void document.exitFullscreen();
    else void this.requestFullscreen?.();
  }

  /** @param {boolean} [on] */
  toggleOverlay(on = this.$('.overlay').hidden) {
    this.$('.overlay').hidden = !on;
    this.$('#numbers').checked = on;
    this.#everySecond();
  }

  /** @param {boolean} [on] */
  toggleMenu(on = this.$('.menu').hidden) {
    // The focus was in it.
    if (!on && !this.$('.menu').hidden) this.$('.settings').focus();
    this.$('.menu').hidden = !on;
    this.$('.settings').setAttribute('aria-expanded', String(on));
    if (on) this.$('#detail').focus();
  }

  /** As of media elements, but for cues that are active: the player itself shows those of its time. */
  get textTracks() { return this.captions.video.textTracks; }
  /** @param {TextTrackKind} kind @param {string} [label] @param {string} [language] */
  addTextTrack(kind, label, language) { return this.captions.video.addTextTrack(kind, label, language); }

  /** A link to this time and camera. */
  get link() {
    const time = this.movie ? this.movie.currentTime.toFixed(3) : '0';
    const player = this.id ? `&player=${encodeURIComponent(this.id)}` : '';
    return `${location.href.split('#')[0]}#t=${time}&cam=${this.view?.orbit}${player}`;
  }

  /** What the address of the page says of time and camera. It is for the player that it names, or the first one. */
  #linkOfPage() {
    const link = parseLink(this.source === this.getAttribute('src') ? location.hash : '');
    const isMeant = link.player === undefined ? (document.querySelector('l4d-player[src]') ?? this) === this :
      link.player === this.id;
    return isMeant ? link : {};
  }

  #listen() {
    const on = (/** @type {string} */ selector, /** @type {string} */ type, /** @type {(e: any) => void} */ fn) =>
      this.$(selector).addEventListener(type, fn);
    on('.play', 'click', () => this.toggle());
    on('.big', 'click', () => this.toggle());
    on('.reset', 'click', () => this.home());
    on('.settings', 'click', () => this.toggleMenu());
    on('.fullscreen', 'click', () => this.toggleFullscreen());
    on('.message button', 'click', () => void this.load(this.source));
    on('.link', 'click', () => {
      void navigator.clipboard?.writeText(this.link).then(() => this.#say('copied'), () => {});
    });
    this.$('.pip').hidden = !hasPictureInPicture();
    on('.pip', 'click', () => void this.requestPictureInPicture().catch(() => {}));
    const range = this.$('.track input');
    range.addEventListener('input', () => this.#scrub(Number(range.value)));
    range.addEventListener('change', () => this.#endScrub());
    range.addEventListener('keydown', (/** @type {KeyboardEvent} */ e) => {
      if (onKey(e, this)) { e.preventDefault(); e.stopPropagation(); }
    });
    on('#detail', 'change', e => this.#setDetail(e.target.value));
    on('#level', 'change', e => { if (this.movie) this.movie.maxLevel = Number(e.target.value); });
    on('#rate', 'change', e => this.setRate(Number(e.target.value)));
    on('#mode', 'change', e => this.#setMode(e.target.value));
    on('#loop', 'change', e => {
      this.loop = e.target.checked;
      if (!e.target.checked) this.setAttribute('playback', 'once');
    });
    this.addEventListener('ratechange', () => { this.$('#rate').value = String(this.playbackRate); });
    on('#numbers', 'change', e => this.toggleOverlay(e.target.checked));
    this.addEventListener('keydown', e => {
      this.#awake();
      if (e.target !== this) return;  // a hotspot has keys of its own
      const inner = /** @type {any} */ (this.shadowRoot)?.activeElement;
      const types = inner?.tagName === 'SELECT' || inner?.tagName === 'BUTTON' && e.key === ' ';
      if (types && e.key !== 'Escape') return;
      if (onKey(e, this)) e.preventDefault();
    });
    // The browser takes a finger that scrolls the page. The second one of two is not primary.
    this.addEventListener('pointercancel', e => {
      if (e.pointerType === 'touch' && e.isPrimary && !this.pointer?.pointers.size && this.hasAttribute('scrolls')) this.#hint('touchHint');
    });
    for (const type of ['pointermove', 'pointerdown', 'focusin']) this.addEventListener(type, () => this.#awake());
    this.addEventListener('dragover', e => { e.preventDefault(); this.toggleAttribute('dragging', true); });
    this.addEventListener('dragleave', () => this.removeAttribute('dragging'));
    this.addEventListener('drop', e => {
      e.preventDefault();
      this.removeAttribute('dragging');
      const file = e.dataTransfer?.files[0];
      if (file) void this.load(file);
    });
  }

  /** Whether the page is to scroll where a finger or a wheel is on the player. */
  #scrolls() {
    const {scrollHeight, scrollWidth} = document.scrollingElement ?? document.documentElement;
    const scrolls = (this.getAttribute('gestures') ?? 'page') === 'page' && document.fullscreenElement !== this &&
      (scrollHeight > innerHeight + 1 || scrollWidth > innerWidth + 1);
    this.toggleAttribute('scrolls', scrolls);
    return scrolls;
  }

  /**
   * Whether a wheel or a pointer is for the camera. By `gestures="page"`, which is the rule, a page scrolls past the player.
   * @param {WheelEvent | PointerEvent} event
   */
  #takes(event) {
    enter(this);
    const scrolls = this.#scrolls();
    if (this.getAttribute('gestures') === 'none') return false;
    if (event.type !== 'wheel' || !scrolls || event.ctrlKey || event.metaKey || this.matches(':focus-within')) return true;
    this.#hint('zoomHint');
    return false;
  }

  /** Shows for a moment what else to do. @param {import('./words.js').Word} word */
  #hint(word) {
    const hint = this.$('.hint');
    hint.textContent = this.texts.say(word);
    hint.classList.add('on');
    clearTimeout(this.hintTimer);
    this.hintTimer = setTimeout(() => hint.classList.remove('on'), 1200);
  }

  /** @param {number} share of the duration */
  #scrub(share) {
    const movie = this.movie;
    if (!movie) return;
    if (!this.scrubbing) {
      this.scrubbing = true;
      this.playedBefore = !movie.paused;
      movie.pause();
    }
    this.scrubbed = movie.timeBegin + share * movie.duration;
    this.$('.track').classList.add('scrubbed');
    this.preview.show(share);
    // One picture after the other, in base colours; detail on release.
    this.seek(this.scrubbed, Math.max(movie.duration / scrubSteps, 1e-3));
  }

  #endScrub() {
    const movie = this.movie;
    if (!movie || !this.scrubbing) return;
    this.scrubbing = false;
    this.$('.track').classList.remove('scrubbed');
    this.seek(this.scrubbed);
    if (this.playedBefore) movie.play();
  }

  /** @param {string} detail */
  #setDetail(detail) {
    if (!['auto', 'base', 'full'].includes(detail)) return;
    this.$('#detail').value = detail;
    if (this.movie) this.movie.detail = /** @type {any} */ (detail);
  }

  /** What comes after the end: the page or its user says so, or else the stream. */
  #setPlayback() {
    const wanted = this.getAttribute('playback') ?? '';
    const stated = this.movie?.info.presentation.playback;
    const playback = this.loop ? 'loop' : playbacks.find(p => p === wanted) ?? stated ?? (wanted === 'auto' ? 'loop' : 'once');
    this.$('#loop').checked = playback === 'loop';
    if (this.movie) this.movie.playback = playback;
  }

  /** @param {string} mode */
  #setMode(mode) {
    if (this.pointer) this.pointer.mode = mode === 'fly' ? 'fly' : 'orbit';
    this.$('#mode').value = mode === 'fly' ? 'fly' : 'orbit';
  }

  /** @param {import('l4dcodec').Movie} movie */
  #fillMenu(movie) {
    const levels = this.$('#level');
    levels.replaceChildren(...Array.from({length: movie.info.numLayers}, (_, k) => {
      const level = movie.info.numLayers - 1 - k;
      const option = new Option('', String(k === 0 ? 0xffffffff : level));
      Object.assign(option.dataset, {text: k === 0 ? 'all' : level === 0 ? 'slow' : 'upTo', level});
      return option;
    }));
    this.texts.fill(levels);
    if (this.hasAttribute('detail')) this.#setDetail(this.getAttribute('detail') ?? 'auto');
    this.#showEnd(movie);
  }

  /** @param {import('l4dcodec').Movie} movie */
  #showEnd(movie) {
    this.$('.end').textContent = movie.live ? this.texts.say('live') : clockText(movie.duration);
    this.#showTime();
    this.#showProgress();
  }

  #showTime() {
    const movie = this.movie;
    if (!movie) return;
    const since = movie.currentTime - movie.timeBegin;
    const share = movie.duration > 0 ? since / movie.duration : 0;
    const range = this.$('.track input');
    if (!this.scrubbing) range.value = String(share);
    range.setAttribute('aria-valuetext', this.texts.say('of', {part: spokenTime(since, this.texts), whole: spokenTime(movie.duration, this.texts)}));
    this.$('.done').style.width = `${100 * share}%`;
    this.$('.now').textContent = clockText(since);
    this.captions.show();
  }

  #showProgress() {
    const movie = this.movie;
    if (!movie) return;
    this.$('.spans').replaceChildren(...movie.buffered.map(([begin, end]) => {
      const span = document.createElement('i');
      span.style.left = `${100 * (begin - movie.timeBegin) / movie.duration}%`;
      span.style.width = `${100 * (end - begin) / movie.duration}%`;
      return span;
    }));
  }

  /** @param {string} type */
  #showState(type) {
    this.$('.play').dataset.label = type === 'play' ? 'pause' : type === 'ended' ? 'again' : 'play';
    this.texts.fill(this.$('.row'));
    this.$('.big').hidden = true;
    this.#say(type === 'play' ? 'playing' : type === 'ended' ? 'ended' : 'paused');
    this.#awake();
  }

  /** @param {import('l4dcodec').Movie} movie */
  #showLosses({losses}) {
    const note = this.$('.note');
    note.hidden = losses.length === 0;
    note.textContent = describeLosses(losses, this.texts);
  }

  /** @param {boolean} on */
  #busy(on) {
    this.$('.spinner').hidden = !on;
    this.#turn();
  }

  /**
   * Turns the ring of what is busy. No animation of the browser does so: Firefox (153) keeps an element for ever, and the player
   * with it, that is removed while one runs.
   */
  #turn() {
    this.turning ||= requestAnimationFrame(now => {
      const spinner = this.$('.spinner');
      this.turning = 0;
      if (spinner.hidden || !this.isConnected) return;
      spinner.style.rotate = `${now / (isStill() ? 3000 : 900) % 1}turn`;
      this.#turn();
    });
  }
  turning = 0;  // the request for the next frame

  /** To screen readers. @param {import('./words.js').Word} word @param {Record<string, string>} [values] */
  #say(word, values) { this.$('.said').textContent = this.texts.say(word, values); }

  /** All texts, in the language of now. */
  #speak() {
    const {language} = this.texts = new Texts(languageOf(this));
    const root = /** @type {ShadowRoot} */ (this.shadowRoot);
    for (const part of root.children) /** @type {HTMLElement} */ (part).lang = language;
    this.texts.fill(root);
    this.captions.list();
    if (!this.movie) return;
    this.#showEnd(this.movie);
    this.#showLosses(this.movie);
    this.#everySecond();
  }
  /** Of the element and of those around it. */
  languages = new MutationObserver(() => { if (languageOf(this) !== this.texts.language) this.#speak(); });

  /** @param {any} error */
  #showError(error) {
    if (error === this.error?.cause) return;  // load() fails with the error of the movie
    // The next load() has a view that may draw.
    if (this.view?.failure) {
      this.#dropView();
      this.movie?.dispose();
      this.movie = null;
      this.setOpen(false);
    }
    this.#busy(false);
    this.setError(error);
    const {title, text} = describeError(error);
    const box = this.$('.message');
    box.classList.toggle('over', true);
    box.querySelector('b').dataset.text = title;
    box.querySelector('p').textContent = text;
    this.texts.fill(box);
    box.hidden = false;
    this.$('.big').hidden = true;
    this.movie?.pause();
    this.dispatchEvent(new CustomEvent('error', {detail: error}));
  }

  #awake() {
    this.removeAttribute('idle');
    clearTimeout(this.idleTimer);
    this.idleTimer = setTimeout(() => {
      const busy = !this.movie || this.movie.paused || !this.$('.menu').hidden;
      this.toggleAttribute('idle', !busy);
    }, 1000 * idleSeconds);
  }

  #everySecond() {
    const view = this.view;
    if (!view || !this.movie || this.$('.overlay').hidden) return;
    const now = performance.now();
    const {frames} = this;
    frames.fps = 1000 * (view.stats.frames - frames.count) / Math.max(now - frames.since, 1);
    Object.assign(frames, {count: view.stats.frames, since: now});
    this.$('.overlay').replaceChildren(...overlayLines(this.movie, view, frames.fps, this.texts).flatMap(([name, value]) => {
      const [term, description] = [document.createElement('dt'), document.createElement('dd')];
      term.textContent = name;
      description.textContent = value;
      return [term, description];
    }));
  }
}

globalThis.customElements?.define('l4d-player', L4DPlayer);
