// SPDX-License-Identifier: Apache-2.0
// Cameras as the renderer has them: x right, y down, z forward.

/** @typedef {[number, number, number]} Vec3 */
/**
 * @typedef {object} Camera
 * @property {number[]} worldToCamera [3, 4] or [4, 4], row-major
 * @property {number} fx pixels @property {number} fy @property {number} cx @property {number} cy
 * @property {number} nearPlane
 * @property {Vec3} [center] where worldToCamera is no rotation and translation alone
 * @property {[number, number]} [depths] of a target with depth: [0] + [1] / distance
 */

/** @param {Vec3} a @param {Vec3} b @returns {Vec3} */
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
/** @param {Vec3} a @param {Vec3} b */
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
/** @param {Vec3} a @param {number} s @param {Vec3} b @returns {Vec3} */
export const madd = (a, s, b) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
/** @param {Vec3} a @returns {Vec3} */
export const unit = a => {
  const n = Math.hypot(...a) || 1;
  return [a[0] / n, a[1] / n, a[2] / n];
};

/** @typedef {{origin: Vec3, direction: Vec3, blur: number}} Ray direction of depth 1; blur: the size of two pixels at depth 1 */

/** A vector in the axes of a camera, in those of the scene. @param {number[]} m world to camera @param {number[]} v */
const toScene = (m, v) => /** @type {Vec3} */ ([0, 1, 2].map(c => m[c] * v[0] + m[4 + c] * v[1] + m[8 + c] * v[2]));

/** Where a camera is. @param {number[]} m world to camera */
export const eyeOf = m => toScene(m, [-m[3], -m[7], -m[11]]);

/** From a camera through a pixel. @param {Camera} camera @param {number} x @param {number} y @returns {Ray} */
export const rayOf = ({worldToCamera: m, fx, fy, cx, cy}, x, y) =>
  ({origin: eyeOf(m), direction: toScene(m, [(x - cx) / fx, (y - cy) / fy, 1]), blur: 2 / fy});

/** Where a camera sees a point, in pixels; null: it is behind it. @param {Camera} camera @param {number[]} point */
export const pixelOf = ({worldToCamera: m, fx, fy, cx, cy, nearPlane}, [x, y, z]) => {
  const [right, down, depth] = [0, 4, 8].map(k => m[k] * x + m[k + 1] * y + m[k + 2] * z + m[k + 3]);
  return depth > nearPlane ? {x: cx + fx * right / depth, y: cy + fy * down / depth, depth} : null;
};

const usualFov = 60 * Math.PI / 180;
/** Beyond them, a camera would look along `up`, or see nothing. */
export const mostPitch = 1.55;
const fovs = [0.02, 3];
/** @param {number} value @param {number[]} range the greater end counts where they cross */
export const within = (value, [least, most]) => Math.min(Math.max(value, least), most);
/** Of the height. @param {{fov: number, isVertical: boolean}} camera @param {{clientWidth: number, clientHeight: number}} canvas */
export const verticalFov = ({fov, isVertical}, {clientWidth: width, clientHeight: height}) =>
  isVertical || width >= height ? fov : 2 * Math.atan(Math.tan(fov / 2) * height / width);
const free = () => ({yaw: [-Infinity, Infinity], pitch: [-Infinity, Infinity], distance: [0, Infinity], fov: [0, Math.PI]});

/** A camera that circles a point, or flies: what pointers and keys move. */
export class OrbitCamera {
  constructor() {
    /** @type {Vec3} */
    this.target = [0, 0, 0];
    this.distance = 5;
    this.yaw = 0;
    this.pitch = 0.15;
    /** @type {Vec3} */
    this.up = [0, -1, 0];
    this.fov = usualFov;
    this.isVertical = false;  // `fov` is that of the height, otherwise of the smaller direction
    /** What turning and zooming stay within, besides what makes sense: radians, units of the scene. */
    this.limits = free();
    this.home = this.state();
  }

  /**
   * Looks at a scene from where the ball that holds most of it fits. Where the stream does not state
   * which way is up, y is down: tools that reconstruct scenes have it so.
   * @param {{middle: number[], radius: number}} bounds
   * @param {number} coordinates of the stream: 0 unknown, 1 y up, 2 y down
   */
  frame(bounds, coordinates) {
    this.fov = usualFov;
    this.isVertical = false;
    this.up = [0, coordinates === 1 ? 1 : -1, 0];
    this.target = /** @type {Vec3} */ (bounds.middle.slice());
    this.distance = Math.max(bounds.radius, 1e-3) / Math.sin(this.fov / 2);
    this.yaw = 0;
    this.pitch = 0.15;
    this.home = this.state();
  }

  /**
   * Looks as a stream suggests.
   * @param {NonNullable<import('l4dcodec').Presentation['camera']>} camera
   */
  place({position, target, up, fov}) {
    this.up = unit(up);
    this.fov = fov;
    this.isVertical = true;
    this.lookAt(position, target);
    this.home = this.state();
  }

  state() {
    return {target: /** @type {Vec3} */ ([...this.target]), distance: this.distance, yaw: this.yaw, pitch: this.pitch,
            up: /** @type {Vec3} */ ([...this.up]), fov: this.fov, isVertical: this.isVertical};
  }
  /** @param {ReturnType<OrbitCamera['state']>} state */
  restore(state) { Object.assign(this, structuredClone(state)); }

  /** Axes of the ground: two along it and up. @returns {[Vec3, Vec3, Vec3]} */
  #ground() {
    const up = this.up;
    const side = /** @type {Vec3} */ (Math.abs(up[0]) > 0.9 ? [0, 1, 0] : [1, 0, 0]);
    const ahead = unit(cross(up, side));
    return [unit(cross(ahead, up)), ahead, up];
  }

  /** Right, down and forward of the camera. @returns {[Vec3, Vec3, Vec3]} */
  axes() {
    const [east, north, up] = this.#ground();
    const level = madd(/** @type {Vec3} */ (north.map(v => v * Math.cos(this.yaw))), Math.sin(this.yaw), east);
    const forward = unit(madd(/** @type {Vec3} */ (level.map(v => v * Math.cos(this.pitch))), -Math.sin(this.pitch), up));
    const right = unit(cross(forward, up));
    return [right, cross(forward, right), forward];
  }

  /** Looks from `eye` at `target`. @param {Vec3} eye @param {Vec3} target */
  lookAt(eye, target) {
    const toward = madd(target, -1, eye);
    const [east, north, up] = this.#ground();
    const forward = unit(toward);
    this.target = [...target];
    this.distance = Math.hypot(...toward);
    this.pitch = Math.asin(Math.min(Math.max(-dot(forward, up), -1), 1));
    this.yaw = Math.atan2(dot(forward, east), dot(forward, north));
  }

  /** @returns {Vec3} */
  eye() { return madd(this.target, -this.distance, this.axes()[2]); }

  /** @param {number} yaw @param {number} pitch radians */
  orbit(yaw, pitch) {
    this.yaw = within(this.yaw + yaw, this.limits.yaw);
    this.pitch = within(within(this.pitch + pitch, [-mostPitch, mostPitch]), this.limits.pitch);
  }

  /** Turns the head: the eye stays. @param {number} yaw @param {number} pitch */
  look(yaw, pitch) {
    const eye = this.eye();
    this.orbit(yaw, pitch);
    this.target = madd(eye, this.distance, this.axes()[2]);
  }

  /** @param {number} right @param {number} down @param {number} forward in units of the distance */
  move(right, down, forward) {
    const [x, y, z] = this.axes();
    for (const [amount, axis] of /** @type {[number, Vec3][]} */ ([[right, x], [down, y], [forward, z]])) {
      this.target = madd(this.target, amount * this.distance, axis);
    }
  }

  /** @param {number} factor */
  zoom(factor) { this.distance = within(within(this.distance * factor, [1e-4, 1e6]), this.limits.distance); }

  /** Changes the field of view. @param {number} factor */
  widen(factor) { this.fov = within(within(this.fov * factor, fovs), this.limits.fov); }

  /** Back to within the limits. @param {{yaw: number, pitch: number, distance: number, fov: number}} state */
  clamp(state = this) {
    for (const name of /** @type {const} */ (['yaw', 'pitch', 'distance', 'fov'])) state[name] = within(state[name], this.limits[name]);
  }

  /** @param {number} width @param {number} height pixels @returns {Camera} */
  camera(width, height) {
    const axes = this.axes();
    const eye = this.eye();
    const focal = (this.isVertical ? height : Math.min(width, height)) / 2 / Math.tan(this.fov / 2);
    return {
      worldToCamera: axes.flatMap(axis => [...axis, -dot(axis, eye)]),
      fx: focal, fy: focal, cx: width / 2, cy: height / 2, nearPlane: Math.min(0.01, this.distance * 0.01)
    };
  }

  /** For links. */
  toString() {
    return [...this.target, this.distance, this.yaw, this.pitch, ...this.up].map(v => Number(v.toFixed(4))).join(',');
  }
  /** @param {string} text @returns {boolean} whether it was one */
  parse(text) {
    const n = text.split(',').map(Number);
    if (n.length !== 9 || !n.every(Number.isFinite)) return false;
    [this.distance, this.yaw, this.pitch] = n.slice(3, 6);
    this.target = [n[0], n[1], n[2]];
    this.up = unit([n[6], n[7], n[8]]);
    return this.distance > 0;
  }
}
