// SPDX-License-Identifier: Apache-2.0

const doubleMs = 250;  // from a tap to a second one, which makes it a double one
const doublePixels = 24;

/**
 * Moves a camera by pointers and the wheel: one finger or the left button turns, two fingers or the right
 * button (or Shift) move, pinch and wheel zoom. Flying, turning keeps the eye where it is.
 */
export class PointerControls {
  /**
   * @param {HTMLElement} target @param {import('./camera.js').OrbitCamera} camera
   * @param {() => void} onChange @param {() => void} onTap
   * @param {(event: WheelEvent | PointerEvent) => boolean} takes whether a wheel or a pointer is for the camera, not for the page
   * @param {((event: PointerEvent) => void) | null} onDouble where it is given, a tap waits for a second one
   */
  constructor(target, camera, onChange, onTap, takes = () => true, onDouble = null) {
    this.onDouble = onDouble;
    /** The tap that waits. @type {{x: number, y: number, timer: any} | null} */
    this.tap = null;
    this.takes = takes;
    this.target = target;
    this.camera = camera;
    this.onChange = onChange;
    this.onTap = onTap;
    /** @type {'orbit' | 'fly'} */
    this.mode = 'orbit';
    /** @type {Map<number, {x: number, y: number}>} */
    this.pointers = new Map();
    this.moved = 0;
    this.control = new AbortController();
    const {signal} = this.control;
    target.addEventListener('pointerdown', e => this.#down(e), {signal});
    target.addEventListener('pointermove', e => this.#move(e), {signal});
    target.addEventListener('pointerup', e => this.#up(e, true), {signal});
    target.addEventListener('pointercancel', e => this.#up(e, false), {signal});
    target.addEventListener('contextmenu', e => e.preventDefault(), {signal});
    target.addEventListener('wheel', e => this.#wheel(e), {signal, passive: false});
  }

  dispose() {
    this.control.abort();
    clearTimeout(this.tap?.timer);
  }

  /** @param {PointerEvent} event */
  #down(event) {
    if (!this.takes(event)) return;
    this.target.setPointerCapture(event.pointerId);
    if (this.pointers.size === 0) this.moved = 0;
    this.pointers.set(event.pointerId, {x: event.clientX, y: event.clientY});
  }

  /** @param {PointerEvent} event @param {boolean} tap */
  #up(event, tap) {
    if (!this.pointers.delete(event.pointerId)) return;
    if (tap && this.pointers.size === 0 && this.moved < 5 && event.button === 0) this.#tapped(event);
  }

  /** @param {PointerEvent} event */
  #tapped(event) {
    const {tap, onDouble} = this;
    const {clientX: x, clientY: y} = event;
    clearTimeout(tap?.timer);
    this.tap = null;
    if (!onDouble) return this.onTap();
    if (tap && Math.hypot(x - tap.x, y - tap.y) < doublePixels) return onDouble(event);
    const timer = setTimeout(() => {
      this.tap = null;
      this.onTap();
    }, doubleMs);
    this.tap = {x, y, timer};
  }

  /** @param {PointerEvent} event */
  #move(event) {
    const last = this.pointers.get(event.pointerId);
    if (!last) return;
    const dx = event.clientX - last.x, dy = event.clientY - last.y;
    this.moved += Math.abs(dx) + Math.abs(dy);
    const unit = 2 / Math.max(this.target.clientHeight, 1);
    if (this.pointers.size === 2) this.#pinch(event, dx, dy, unit);
    else if (event.buttons & 2 || event.shiftKey) this.camera.move(-dx * unit * 0.55, -dy * unit * 0.55, 0);
    else this.turn(dx * unit, dy * unit);
    this.pointers.set(event.pointerId, {x: event.clientX, y: event.clientY});
    this.onChange();
  }

  /** @param {PointerEvent} event @param {number} dx @param {number} dy @param {number} unit */
  #pinch(event, dx, dy, unit) {
    const [[, other]] = [...this.pointers].filter(([id]) => id !== event.pointerId);
    const at = /** @type {{x: number, y: number}} */ (this.pointers.get(event.pointerId));
    const before = Math.hypot(at.x - other.x, at.y - other.y);
    const after = Math.hypot(event.clientX - other.x, event.clientY - other.y);
    if (before > 0 && after > 0) this.camera.zoom(before / after);
    this.camera.move(-dx * unit * 0.28, -dy * unit * 0.28, 0);
  }

  /** @param {number} x @param {number} y */
  turn(x, y) {
    if (this.mode === 'fly') this.camera.look(x * 0.8, y * 0.8);
    else this.camera.orbit(x * 1.6, y * 1.6);
  }

  /** @param {WheelEvent} event */
  #wheel(event) {
    if (!this.takes(event)) return;
    event.preventDefault();
    const pixels = event.deltaY * [1, 16, 240][event.deltaMode];
    if (this.mode === 'fly') this.camera.move(0, 0, -pixels * 0.001);
    else this.camera.zoom(Math.exp(pixels * 0.0012));
    this.onChange();
  }
}
