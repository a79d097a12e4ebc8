// SPDX-License-Identifier: Apache-2.0

const frame = typeof requestAnimationFrame === 'function' ?
  requestAnimationFrame.bind(globalThis) : (/** @type {any} */ fn) => setTimeout(() => fn(performance.now()), 16);

/** The time of a movie while it plays: it waits where the movie is not ready. */
export class Clock {
  /** @param {import('./movie.js').Movie} movie */
  constructor(movie) {
    this.movie = movie;
    this.time = movie.timeBegin;
    this.rate = 1;
    /** What comes after the end. @type {'once' | 'loop' | 'ping-pong'} */
    this.playback = 'once';
    this.direction = 1;  // -1: backwards in ping-pong
    this.paused = true;
    this.stalled = false;
    /** @type {HTMLMediaElement | null} */
    this.media = null;
    this.last = 0;
    this.asked = -Infinity;
    this.disposed = false;
    this.ticking = false;
  }

  play() {
    if (!this.paused) return;
    this.paused = false;
    const turns = this.playback === 'ping-pong';
    if (this.time >= this.movie.timeEnd && this.rate > 0 && !this.movie.live && !turns) void this.movie.seek(this.movie.timeBegin).catch(() => {});
    if (this.time <= this.movie.timeBegin && this.rate < 0 && !turns) void this.movie.seek(this.movie.timeEnd).catch(() => {});
    this.last = performance.now();
    this.movie.emit('play');
    this.#next();
  }

  pause() {
    if (this.paused) return;
    this.paused = true;
    this.movie.emit('pause');
  }

  /** Seconds of the movie in a second. */
  get velocity() { return this.rate * this.direction; }

  /** @param {'once' | 'loop' | 'ping-pong'} playback */
  setPlayback(playback) {
    this.playback = playback;
    if (playback !== 'ping-pong') this.direction = 1;
  }

  /** @param {number} time */
  jump(time) {
    this.time = time;
    this.asked = time;
    this.movie.emit('time', time);
  }

  /** @param {HTMLMediaElement | null} media */
  sync(media) {
    this.media = media;
    if (media) this.#next();
  }

  dispose() { this.disposed = true; }

  #next() {
    if (this.ticking || this.disposed) return;
    this.ticking = true;
    frame((/** @type {number} */ now) => {
      this.ticking = false;
      if (this.disposed) return;
      this.#tick(now);
      if (!this.paused || this.media) this.#next();
    });
  }

  /** @param {number} now ms */
  #tick(now) {
    const {timeBegin, timeEnd} = this.movie;
    const elapsed = Math.min(Math.max(now - this.last, 0), 250) / 1000;
    this.last = now;
    if (this.media) {
      const time = Math.min(timeBegin + this.media.currentTime, timeEnd);
      if (Math.abs(time - this.time) > 1e-6) this.#move(time);
      return;
    }
    if (this.paused) return;
    const {velocity} = this;
    const to = this.time + elapsed * velocity;
    if (to >= timeEnd && this.movie.live) return this.#stall(true);
    if (to >= timeEnd || to < timeBegin) {
      if (this.playback === 'ping-pong') {
        // Where a frame takes no time, it is still at the end that it turned at.
        if (to >= timeEnd === velocity > 0) this.direction = -this.direction;
        this.#move(Math.min(Math.max(to, timeBegin), timeEnd));
      } else if (this.playback === 'loop') {
        void this.movie.seek(to >= timeEnd ? timeBegin : timeEnd - 1e-3).catch(() => {});
      } else {
        this.#move(Math.min(Math.max(to, timeBegin), timeEnd));
        this.paused = true;
        this.movie.emit('pause');
        this.movie.emit('ended');
      }
      return;
    }
    const {from, until} = this.movie.ready;
    const stalled = velocity > 0 && (to > until + 1e-6 || to < from - 1e-6);
    this.#stall(stalled);
    if (!stalled) this.#move(to);
  }

  /** @param {boolean} stalled */
  #stall(stalled) {
    if (stalled !== this.stalled) {
      this.stalled = stalled;
      this.movie.emit(stalled ? 'stall' : 'resume');
    }
    if (stalled) this.#ask();
  }

  /** @param {number} time */
  #move(time) {
    this.time = time;
    this.#ask();
    this.movie.emit('time', time);
  }

  /** Asks for what comes next, every half second of it. */
  #ask() {
    if (Math.abs(this.time - this.asked) < 0.5 && !(this.stalled && performance.now() - this.askedAt > 1000)) return;
    this.asked = this.time;
    this.askedAt = performance.now();
    this.movie.advance(this.time);
  }
  askedAt = 0;
}
