// SPDX-License-Identifier: Apache-2.0
import {open} from 'l4dcodec';
import {PointerControls} from './controls.js';
import {onKey} from './keys.js';
import {addStyle, icons, html} from './template.js';
import {clockText, describeError, describeLosses, overlayLines, parseLink, spokenTime} from './text.js';
import {View} from './view.js';

const Base = globalThis.HTMLElement ?? /** @type {any} */ (class {});
const idleSeconds = 2.5;

/**
 * `<l4d-player src poster autoplay loop camera="orbit|fly" detail="auto|base|full" backend="webgl2|webgpu|auto" overlay>`:
 * a player with controls. Events: 'open', 'error', 'backend' (which one draws); `movie` and `view` are what they say.
 */
export class L4DPlayer extends Base {
  static observedAttributes = ['src', 'poster', 'loop', 'detail', 'camera', 'overlay'];

  constructor() {
    super();
    const root = this.attachShadow({mode: 'open'});
    root.innerHTML = html;
    addStyle(root);
    /** @type {(selector: string) => any} */
    this.$ = selector => root.querySelector(selector);
    /** @type {import('l4dcodec').Movie | null} */
    this.movie = null;
    /** @type {View | null} */
    this.view = null;
    /** @type {PointerControls | null} */
    this.controls = null;
    this.loading = new AbortController();
    this.frames = {count: 0, since: performance.now(), fps: 0};
    this.scrubbing = false;
    this.#listen();
  }

  connectedCallback() {
    this.#setView();
    const source = this.getAttribute('src');
    if (source && !this.movie) void this.load(source);
    this.timer = setInterval(() => this.#everySecond(), 500);
  }

  disconnectedCallback() {
    clearInterval(this.timer);
    this.unload();
    this.controls?.dispose();
    const gl = this.view?.gl;
    this.view?.dispose();
    this.view = this.controls = null;
    // A page may have few contexts, and one lives until its canvas is collected. The next view has another canvas.
    const canvas = this.$('canvas');
    canvas.replaceWith(canvas.cloneNode());
    gl?.getExtension('WEBGL_lose_context')?.loseContext();
  }

  /** @param {string} name @param {string | null} before @param {string | null} value */
  attributeChangedCallback(name, before, value) {
    // Before the view is there, connectedCallback is still to come, and loads it.
    if (name === 'src' && value && value !== before && this.view) void this.load(value);
    if (name === 'poster') {
      this.$('.poster').hidden = !value;
      this.$('.poster').src = value ?? '';
    }
    if (name === 'loop') {
      this.$('#loop').checked = value !== null;
      if (this.movie) this.movie.loop = value !== null;
    }
    if (name === 'detail' && value) this.#setDetail(value);
    if (name === 'camera') this.#setMode(value === 'fly' ? 'fly' : 'orbit');
    if (name === 'overlay') this.toggleOverlay(value !== null);
  }

  #setView() {
    if (this.view) return;
    const canvas = this.$('canvas');
    try {
      const backend = /** @type {any} */ (this.getAttribute('backend') ?? undefined);
      this.view = new View(canvas, {background: [0.043, 0.051, 0.063], backend});
    } catch (error) {
      return this.#showError(error);
    }
    void this.view.ready.then(backend => this.dispatchEvent(new CustomEvent('backend', {detail: backend})),
                              error => this.#showError(error));
    this.controls = new PointerControls(canvas, this.view.orbit, () => { this.view?.change(); this.#awake(); },
                                        () => this.toggle());
    this.#setMode(this.getAttribute('camera') === 'fly' ? 'fly' : 'orbit');
  }

  /** Opens a file and shows it. @param {string | URL | Blob | ArrayBuffer | ArrayBufferView} source */
  async load(source) {
    this.unload();
    const {signal} = this.loading;
    this.source = source;
    this.$('.message').hidden = true;
    this.#busy(true);
    try {
      const movie = await open(source, {signal});
      if (signal.aborted) return movie.dispose();
      this.movie = movie;
      await this.#begin(movie);
    } catch (error) {
      if (!signal.aborted) this.#showError(error);
    }
  }

  /** @param {import('l4dcodec').Movie} movie */
  async #begin(movie) {
    movie.loop = this.hasAttribute('loop');
    movie.on('time', () => this.#showTime());
    movie.on('progress', () => this.#showProgress());
    for (const type of ['play', 'pause', 'ended']) movie.on(type, () => this.#showState(type));
    movie.on('stall', () => this.#busy(true));
    movie.on('resume', () => this.#busy(false));
    movie.on('ready', () => this.#busy(false));
    movie.on('error', error => this.#showError(error));
    movie.on('grown', ({live}) => {
      this.#showEnd(movie);
      if (!live) this.#say('The recording has ended');
    });
    movie.on('retry', () => this.#say('The connection is slow, trying again'));
    this.#fillMenu(movie);
    movie.on('loss', () => this.#showLosses(movie));
    this.#showLosses(movie);
    await this.view?.show(movie);
    const link = parseLink(this.hasAttribute('src') ? location.hash : '');
    await movie.seek(link.time ?? movie.startTime);
    if (!(link.camera && this.view?.orbit.parse(link.camera))) await this.view?.home();
    await this.view?.settled();
    if (this.movie !== movie) return;
    this.$('.poster').classList.add('gone');
    this.#busy(false);
    this.#showTime();
    this.#showProgress();
    const still = matchMedia('(prefers-reduced-motion: reduce)').matches;
    if (this.hasAttribute('autoplay') && !still) movie.play();
    else this.$('.big').hidden = false;
    this.#say(movie.live ? 'Ready, live' : `Ready, ${spokenTime(movie.duration)}`);
    this.dispatchEvent(new CustomEvent('open', {detail: movie}));
  }

  unload() {
    this.loading.abort();
    this.loading = new AbortController();
    this.view?.hide();
    this.movie?.dispose();
    this.movie = null;
    this.$('.big').hidden = true;
  }

  toggle() {
    if (!this.movie) return;
    if (this.movie.paused) this.movie.play();
    else this.movie.pause();
  }

  /** @param {number} time */
  seek(time) {
    if (!this.movie) return;
    if (time > this.movie.timeEnd && this.movie.loop) time = this.movie.timeBegin;
    void this.movie.seek(time).catch(() => {});
    this.#awake();
  }

  /** @param {number} rate */
  setRate(rate) {
    if (!this.movie) return;
    this.movie.rate = Math.min(Math.max(rate, 0.25), 4);
    this.$('#rate').value = String(this.movie.rate);
    this.#say(`Speed ${this.movie.rate}`);
  }

  home() { void this.view?.home(); }

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
    this.$('.menu').hidden = !on;
    this.$('.settings').setAttribute('aria-expanded', String(on));
    if (on) this.$('#detail').focus();
  }

  /** A link to this time and camera. */
  get link() {
    const time = this.movie ? this.movie.currentTime.toFixed(3) : '0';
    return `${location.href.split('#')[0]}#t=${time}&cam=${this.view?.orbit}`;
  }

  #listen() {
    const on = (/** @type {string} */ selector, /** @type {string} */ type, /** @type {(e: any) => void} */ fn) =>
      this.$(selector).addEventListener(type, fn);
    on('.play', 'click', () => this.toggle());
    on('.big', 'click', () => this.toggle());
    on('.reset', 'click', () => this.home());
    on('.settings', 'click', () => this.toggleMenu());
    on('.fullscreen', 'click', () => this.toggleFullscreen());
    on('.message button', 'click', () => this.source && this.load(this.source));
    on('.link', 'click', () => {
      void navigator.clipboard?.writeText(this.link).then(() => this.#say('Link copied'), () => {});
    });
    const range = this.$('.track input');
    range.addEventListener('input', () => this.#scrub(Number(range.value)));
    range.addEventListener('change', () => this.#endScrub());
    range.addEventListener('keydown', (/** @type {KeyboardEvent} */ e) => {
      if (onKey(e, this)) { e.preventDefault(); e.stopPropagation(); }
    });
    on('.track', 'pointermove', e => this.#hover(e));
    on('#detail', 'change', e => this.#setDetail(e.target.value));
    on('#level', 'change', e => { if (this.movie) this.movie.maxLevel = Number(e.target.value); });
    on('#rate', 'change', e => this.setRate(Number(e.target.value)));
    on('#mode', 'change', e => this.#setMode(e.target.value));
    on('#loop', 'change', e => this.toggleAttribute('loop', e.target.checked));
    on('#numbers', 'change', e => this.toggleOverlay(e.target.checked));
    this.addEventListener('keydown', e => {
      this.#awake();
      const inner = /** @type {any} */ (this.shadowRoot)?.activeElement;
      const types = inner?.tagName === 'SELECT' || inner?.tagName === 'BUTTON' && e.key === ' ';
      if (types && e.key !== 'Escape') return;
      if (onKey(e, this)) e.preventDefault();
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
    document.addEventListener('visibilitychange', () => {
      if (document.hidden && this.movie && !this.movie.paused) this.movie.pause();
    });
  }

  /** @param {number} share of the duration */
  #scrub(share) {
    const movie = this.movie;
    if (!movie) return;
    if (!this.scrubbing) {
      this.scrubbing = true;
      this.playedBefore = !movie.paused;
      movie.pause();
      // Base colours while dragging, detail on release.
      this.detailBefore = movie.detail;
      movie.setDetail('base');
    }
    this.seek(movie.timeBegin + share * movie.duration);
  }

  #endScrub() {
    const movie = this.movie;
    if (!movie || !this.scrubbing) return;
    this.scrubbing = false;
    movie.detail = this.detailBefore ?? 'auto';
    if (this.playedBefore) movie.play();
  }

  /** @param {PointerEvent} event */
  #hover(event) {
    if (!this.movie) return;
    const box = this.$('.track').getBoundingClientRect();
    const share = Math.min(Math.max((event.clientX - box.left) / box.width, 0), 1);
    const bubble = this.$('.hover');
    bubble.textContent = clockText(share * this.movie.duration);
    bubble.style.left = `${100 * share}%`;
  }

  /** @param {string} detail */
  #setDetail(detail) {
    if (!['auto', 'base', 'full'].includes(detail)) return;
    this.$('#detail').value = detail;
    if (this.movie) this.movie.detail = /** @type {any} */ (detail);
  }

  /** @param {string} mode */
  #setMode(mode) {
    if (this.controls) this.controls.mode = mode === 'fly' ? 'fly' : 'orbit';
    this.$('#mode').value = mode === 'fly' ? 'fly' : 'orbit';
  }

  /** @param {import('l4dcodec').Movie} movie */
  #fillMenu(movie) {
    const levels = this.$('#level');
    levels.replaceChildren(...Array.from({length: movie.info.numLayers}, (_, k) => {
      const level = movie.info.numLayers - 1 - k;
      const name = k === 0 ? 'All' : level === 0 ? 'Slow only' : `Up to level ${level}`;
      return new Option(name, String(k === 0 ? 0xffffffff : level));
    }));
    if (this.hasAttribute('detail')) this.#setDetail(this.getAttribute('detail') ?? 'auto');
    this.#showEnd(movie);
  }

  /** @param {import('l4dcodec').Movie} movie */
  #showEnd(movie) {
    this.$('.end').textContent = movie.live ? 'live' : clockText(movie.duration);
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
    range.setAttribute('aria-valuetext', `${spokenTime(since)} of ${spokenTime(movie.duration)}`);
    this.$('.done').style.width = `${100 * share}%`;
    this.$('.now').textContent = clockText(since);
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
    const name = type === 'play' ? 'Pause' : type === 'ended' ? 'Play again' : 'Play';
    const button = this.$('.play');
    button.innerHTML = type === 'play' ? icons.pause : type === 'ended' ? icons.again : icons.play;
    button.setAttribute('aria-label', name);
    button.title = `${name} (space)`;
    this.$('.big').hidden = true;
    this.#say(type === 'play' ? 'Playing' : type === 'ended' ? 'The end' : 'Paused');
    this.#awake();
  }

  /** @param {import('l4dcodec').Movie} movie */
  #showLosses({losses}) {
    const note = this.$('.note');
    note.hidden = losses.length === 0;
    note.textContent = describeLosses(losses);
  }

  /** @param {boolean} on */
  #busy(on) { this.$('.spinner').hidden = !on; }

  /** @param {string} text */
  #say(text) { this.$('.said').textContent = text; }

  /** @param {any} error */
  #showError(error) {
    this.#busy(false);
    const {title, text} = describeError(error);
    const box = this.$('.message');
    box.classList.toggle('over', true);
    box.querySelector('b').textContent = title;
    box.querySelector('p').textContent = text;
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
    this.$('.overlay').replaceChildren(...overlayLines(this.movie, view, frames.fps).flatMap(([name, value]) => {
      const [term, description] = [document.createElement('dt'), document.createElement('dd')];
      term.textContent = name;
      description.textContent = value;
      return [term, description];
    }));
  }
}

globalThis.customElements?.define('l4d-player', L4DPlayer);
