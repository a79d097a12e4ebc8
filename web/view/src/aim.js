// SPDX-License-Identifier: Apache-2.0
// Where the camera of <l4d-player> looks, as attributes say.
import {mostPitch, verticalFov, within} from './camera.js';
import {angleOf, lengthsOf, pointOf, wordsOf} from './units.js';

const settleSeconds = 0.12;  // in which a camera that is sent somewhere leaves a third of its way
const usualDelay = 3000;     // ms without a touch, before it turns by itself
const usualTurn = Math.PI / 32;  // a second

/** @typedef {ReturnType<import('./camera.js').OrbitCamera['state']>} State */
/** @typedef {'user-interaction' | 'automatic' | 'none'} Source what moves a camera; none: the page does */

export const isStill = () => matchMedia('(prefers-reduced-motion: reduce)').matches;

/** Sends the camera of a player where attributes say, and turns it by itself. */
export class Aim {
  /** @param {import('./camera-element.js').CameraElement} player */
  constructor(player) {
    this.player = player;
    /** @type {State | null} */
    this.goal = null;
    /** Where it came from, and how much of the way remains. @type {{state: State, rest: number} | null} */
    this.way = null;
    /** @type {Source} of the last change */
    this.source = 'none';
    this.isTurning = false;
    this.sense = 1;  // in which it turns
    this.frame = 0;
    this.last = 0;  // frame's time; 0: nothing moves
  }

  /** The first view, at once. */
  async home() {
    const {view} = this.player;
    await view?.home();
    if (!view || view !== this.player.view) return;
    this.goal = null;
    this.#limit();
    for (const name of ['camera-orbit', 'camera-target', 'field-of-view']) {
      if (this.player.hasAttribute(name)) this.steer(this.#wanted(name));
    }
    this.jump();
    this.wait();
  }

  /** An attribute has changed. @param {string} name */
  update(name) {
    if (/^(auto|rotation)-/.test(name)) return this.wait();
    // Before a scene is there, home() is still to come.
    if (!this.player.view || !this.player.movie) return;
    if (/^m(in|ax)-/.test(name)) this.#limit();
    else this.steer(this.#wanted(name));
  }

  /**
   * Moves the camera there, within the limits.
   * @param {Partial<State>} goal the rest stays @param {Source} [source]
   */
  steer(goal, source = 'none') {
    const {view} = this.player;
    if (!view) return;
    const {orbit} = view;
    if (goal.fov !== undefined) this.#makeVertical();
    const state = orbit.state();
    const end = {...state, ...this.goal, ...goal, isVertical: state.isVertical};
    orbit.clamp(end);
    // The shorter way round, where all of it is free.
    if (!orbit.limits.yaw.some(Number.isFinite)) state.yaw += 2 * Math.PI * Math.round((end.yaw - state.yaw) / (2 * Math.PI));
    Object.assign(this, {goal: end, source, way: {state, rest: 1}});
    if (isStill()) this.jump();
    else this.#run();
  }

  /** Ends the way. */
  jump() {
    const {goal, player: {view}} = this;
    this.goal = null;
    if (goal) view?.orbit.restore(goal);
    view?.change();
  }

  /** Somebody moves the camera. */
  touched() {
    this.goal = null;
    this.source = 'user-interaction';
    this.wait();
  }

  /** Turns by itself, if it should, after some time without a touch. */
  wait() {
    const {player} = this;
    this.end();
    if (!player.hasAttribute('auto-rotate') || isStill()) return;
    const delay = Number(player.getAttribute('auto-rotate-delay') ?? usualDelay);
    this.timer = setTimeout(() => {
      this.isTurning = true;
      this.#run();
    }, Number.isFinite(delay) ? delay : usualDelay);
  }

  /** Turns no more. */
  end() {
    clearTimeout(this.timer);
    this.isTurning = false;
  }

  #run() { this.frame ||= requestAnimationFrame(now => this.#step(now)); }

  /** @param {number} now ms */
  #step(now) {
    const {player, goal} = this;
    const {view} = player;
    const seconds = Math.min((now - (this.last || now - 16)) / 1000, 1);
    Object.assign(this, {frame: 0, last: 0});
    if (!view || !player.movie || !goal && !this.isTurning) return;
    // Nobody would see it.
    if (!goal && !player.isNear) return this.wait();
    if (goal) this.#approach(view.orbit, goal, seconds);
    else this.#turn(view.orbit, seconds);
    view.change();
    this.last = now;
    this.#run();
  }

  /** @param {import('./camera.js').OrbitCamera} orbit @param {State} goal @param {number} seconds */
  #approach(orbit, goal, seconds) {
    const way = /** @type {NonNullable<Aim['way']>} */ (this.way);
    const {state} = way;
    way.rest *= Math.exp(-seconds / settleSeconds);
    if (way.rest < 1e-3) return this.jump();
    const between = (/** @type {number} */ from, /** @type {number} */ to) => to + (from - to) * way.rest;
    for (const name of /** @type {const} */ (['yaw', 'pitch', 'distance', 'fov'])) orbit[name] = between(state[name], goal[name]);
    orbit.target = /** @type {import('./camera.js').Vec3} */ (goal.target.map((v, k) => between(state.target[k], v)));
  }

  /** @param {import('./camera.js').OrbitCamera} orbit @param {number} seconds */
  #turn(orbit, seconds) {
    const {yaw} = orbit;
    orbit.orbit(this.sense * seconds * (angleOf(this.player.getAttribute('rotation-per-second')) ?? usualTurn), 0);
    if (orbit.yaw === yaw) this.sense *= -1;  // at a limit
    this.source = 'automatic';
  }

  /** What `camera-orbit` and its limits say: angles as <model-viewer> has them. @param {string} name */
  #orbit(name) {
    const {player} = this;
    const [azimuth, polar, radius] = wordsOf(player.getAttribute(name));
    const theta = angleOf(azimuth), phi = angleOf(polar);
    return {
      yaw: theta === undefined ? undefined : -theta,
      pitch: phi === undefined ? undefined : within(Math.PI / 2 - phi, [-mostPitch, mostPitch]),
      distance: lengthsOf(player.metresPerUnit, player.view?.orbit.home.distance ?? 1)(radius)
    };
  }

  /** What an attribute wants; where it leaves something open, what the first view has. @param {string} name @returns {Partial<State>} */
  #wanted(name) {
    const {player} = this;
    const view = /** @type {import('./view.js').View} */ (player.view);
    const {home} = view.orbit;
    const text = player.getAttribute(name);
    if (name === 'camera-target') return {target: pointOf(text, lengthsOf(player.metresPerUnit, 1)) ?? home.target};
    if (name === 'field-of-view') return {fov: angleOf(text) ?? verticalFov(home, view.canvas)};
    const {yaw = home.yaw, pitch = home.pitch, distance = home.distance} = this.#orbit(name);
    return {yaw, pitch, distance: distance > 0 ? distance : home.distance};
  }

  #makeVertical() {
    const {orbit, canvas} = /** @type {import('./view.js').View} */ (this.player.view);
    for (const state of [orbit, this.goal]) if (state) Object.assign(state, {fov: verticalFov(state, canvas), isVertical: true});
  }

  /** Reads the limits, and moves the camera into them. */
  #limit() {
    const {player} = this;
    const least = this.#orbit('min-camera-orbit'), most = this.#orbit('max-camera-orbit');
    const fovs = ['min-field-of-view', 'max-field-of-view'].map(name => angleOf(player.getAttribute(name)));
    if (fovs.some(fov => fov !== undefined)) this.#makeVertical();
    // Azimuth and polar angle grow where yaw and pitch fall.
    /** @type {import('./view.js').View} */ (player.view).orbit.limits = {
      yaw: [most.yaw ?? -Infinity, least.yaw ?? Infinity], pitch: [most.pitch ?? -Infinity, least.pitch ?? Infinity],
      distance: [least.distance ?? 0, most.distance ?? Infinity], fov: [fovs[0] ?? 0, fovs[1] ?? Math.PI]
    };
    this.steer({});
  }
}
