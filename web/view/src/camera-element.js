// SPDX-License-Identifier: Apache-2.0
// The camera of <l4d-player>, with the names that <model-viewer> has.
import {Aim} from './aim.js';
import {dot, madd, OrbitCamera, verticalFov} from './camera.js';
import {MediaElement} from './media.js';
import {pictureOf} from './picture.js';
import {PictureInPicture} from './pip.js';
import {degree} from './units.js';

export const cameraAttributes = ['camera-orbit', 'camera-target', 'field-of-view', 'min-camera-orbit', 'max-camera-orbit',
                                 'min-field-of-view', 'max-field-of-view', 'auto-rotate', 'auto-rotate-delay', 'rotation-per-second'];
export const cameraProperties = cameraAttributes.map(name => name.replace(/-(\w)/g, (_, letter) => letter.toUpperCase()));

/** Properties reflect attributes; event: 'camera-change'. */
export class CameraElement extends MediaElement {
  constructor() {
    super();
    /** @type {import('./view.js').View | null} */
    this.view = null;
    /** @type {import('./controls.js').PointerControls | null} */
    this.pointer = null;
    this.near = true;  // less than its page's height from what is seen of the page
    this.pip = new PictureInPicture(this);
    this.aim = new Aim(this);
    this.seen = '';  // camera of the picture before
  }

  /** Whether its picture is seen, or soon may be. */
  get isNear() { return this.near || this.pip.isOn; }

  /** Of what the scene says; null: it does not. */
  get metresPerUnit() { return this.movie?.info.presentation.metresPerUnit ?? null; }

  /** @param {string} name @param {string | null} value null: none */
  #set(name, value) {
    if (value === null) this.removeAttribute(name);
    else this.setAttribute(name, String(value));
  }
  get cameraOrbit() { return this.getAttribute('camera-orbit'); }
  set cameraOrbit(orbit) { this.#set('camera-orbit', orbit); }
  get cameraTarget() { return this.getAttribute('camera-target'); }
  set cameraTarget(target) { this.#set('camera-target', target); }
  get fieldOfView() { return this.getAttribute('field-of-view'); }
  set fieldOfView(fov) { this.#set('field-of-view', fov); }
  get minCameraOrbit() { return this.getAttribute('min-camera-orbit'); }
  set minCameraOrbit(orbit) { this.#set('min-camera-orbit', orbit); }
  get maxCameraOrbit() { return this.getAttribute('max-camera-orbit'); }
  set maxCameraOrbit(orbit) { this.#set('max-camera-orbit', orbit); }
  get minFieldOfView() { return this.getAttribute('min-field-of-view'); }
  set minFieldOfView(fov) { this.#set('min-field-of-view', fov); }
  get maxFieldOfView() { return this.getAttribute('max-field-of-view'); }
  set maxFieldOfView(fov) { this.#set('max-field-of-view', fov); }
  get autoRotate() { return this.hasAttribute('auto-rotate'); }
  set autoRotate(on) { this.toggleAttribute('auto-rotate', Boolean(on)); }
  /** ms @returns {number} */
  get autoRotateDelay() { return Number(this.getAttribute('auto-rotate-delay') ?? 3000); }
  set autoRotateDelay(delay) { this.setAttribute('auto-rotate-delay', String(delay)); }
  get rotationPerSecond() { return this.getAttribute('rotation-per-second'); }
  set rotationPerSecond(angle) { this.#set('rotation-per-second', angle); }

  /** Radians and units of the scene, of now; as text, what `camera-orbit` takes. */
  getCameraOrbit() {
    const {yaw, pitch, distance} = this.#orbit();
    const [theta, phi] = [-yaw, Math.PI / 2 - pitch];
    return {theta, phi, radius: distance, toString: () => `${theta}rad ${phi}rad ${distance}`};
  }
  getCameraTarget() {
    const [x, y, z] = this.#orbit().target;
    return {x, y, z, toString: () => `${x} ${y} ${z}`};
  }
  /** Degrees, of the height. */
  getFieldOfView() { return (this.view ? verticalFov(this.view.orbit, this.view.canvas) : this.#orbit().fov) / degree; }
  #orbit() { return this.view?.orbit ?? new OrbitCamera(); }

  /** Is at once where attributes send the camera. */
  jumpCameraToGoal() { this.aim.jump(); }

  /** Somebody has moved the camera. */
  steered() {
    this.aim.touched();
    this.view?.change();
  }

  /** A picture was drawn. */
  drawn() {
    const {aim, view} = this;
    const seen = `${view?.orbit},${view?.orbit.fov}`;
    if (seen === this.seen) return;
    this.seen = seen;
    this.dispatchEvent(new CustomEvent('camera-change', {detail: {source: aim.source}}));
    if (!aim.goal && !aim.isTurning) aim.source = 'none';
  }

  /**
   * The position in the scene that is seen at a point of the window, as of events of the pointer; null: nothing is.
   * @param {number} clientX @param {number} clientY @returns {Promise<import('./camera.js').Vec3 | null>}
   */
  async queryPosition(clientX, clientY) {
    const {view} = this;
    if (!view || !this.isOpen) return null;
    const {left, top, width, height} = view.canvas.getBoundingClientRect();
    const [x, y] = [(clientX - left) / width, (clientY - top) / height];
    const isInside = x >= 0 && y >= 0 && x <= 1 && y <= 1;
    return isInside ? view.positionAt(x * view.canvas.width, y * view.canvas.height) : null;
  }

  /** Circles what is seen at a point of the window; flying, looks at it from where it is. @param {number} clientX @param {number} clientY */
  async lookAtPoint(clientX, clientY) {
    const target = await this.queryPosition(clientX, clientY);
    const {view} = this;
    if (!target || !view) return;
    const camera = new OrbitCamera();
    camera.restore(view.orbit.state());
    const eye = camera.eye();
    if (this.pointer?.mode === 'fly') camera.lookAt(eye, target);
    // What is looked at stays as large as it is.
    else camera.distance = dot(madd(target, -1, eye), camera.axes()[2]);
    const {yaw, pitch, distance} = camera;
    this.aim.touched();
    this.aim.steer({target, yaw, pitch, distance}, 'user-interaction');
  }

  /** What is shown now, as a picture. @param {import('./picture.js').PictureOptions} [options] @returns {Promise<Blob>} */
  async toBlob(options = {}) {
    if (!this.view || !this.isOpen) throw new DOMException('no scene is shown', 'InvalidStateError');
    return pictureOf(this.view, options);
  }

  /** As of <video>: shows the picture in a window over others. @returns {Promise<PictureInPictureWindow>} */
  requestPictureInPicture() { return this.pip.enter(); }
}
