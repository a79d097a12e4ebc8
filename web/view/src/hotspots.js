// SPDX-License-Identifier: Apache-2.0
import {pixelOf} from './camera.js';
import {lengthsOf, pointOf} from './units.js';

const attributes = ['slot', 'data-position', 'data-begin', 'data-end'];

/** @param {string | undefined} text @param {number} otherwise */
const seconds = (text, otherwise) => {
  const value = Number(text || NaN);
  return Number.isNaN(value) ? otherwise : value;
};

/**
 * Children of a player with `slot="hotspot-.."`: where `data-position` is in the picture, from `data-begin` until `data-end`.
 * Each has a slot of its own that moves; what is not seen has no box, and cannot get the focus.
 */
export class Hotspots {
  /** @param {import('./camera-element.js').CameraElement} player @param {HTMLElement} layer of its shadow */
  constructor(player, layer) {
    this.player = player;
    this.layer = layer;
    /** By name; of children with the same name, the first one counts. @type {Map<string, {slot: HTMLSlotElement, data: DOMStringMap}>} */
    this.spots = new Map();
    new MutationObserver(() => this.read()).observe(player, {childList: true, subtree: true, attributeFilter: attributes});
  }

  /** Children have come, gone or changed. */
  read() {
    /** @type {Hotspots['spots']} */
    const spots = new Map();
    for (const child of this.player.children) {
      const name = child.slot;
      if (!name.startsWith('hotspot-') || spots.has(name)) continue;
      const slot = this.spots.get(name)?.slot ?? Object.assign(document.createElement('slot'), {name, hidden: true});
      // In the order that the Tab key takes.
      const there = this.layer.children[spots.size] ?? null;
      if (there !== slot) this.layer.insertBefore(slot, there);
      spots.set(name, {slot, data: /** @type {HTMLElement} */ (child).dataset});
    }
    while (this.layer.children.length > spots.size) this.layer.lastChild?.remove();
    this.spots = spots;
    this.place();
  }

  /** Moves them to where they are in the picture that is shown. */
  place() {
    const {view, movie, currentTime, metresPerUnit} = this.player;
    if (this.spots.size === 0 || !view || !movie) return;
    const camera = view.camera();
    const {width, height, clientWidth, clientHeight} = view.canvas;
    const length = lengthsOf(metresPerUnit, 1);
    for (const {slot, data} of this.spots.values()) {
      const point = pointOf(data.position, length);
      const isNow = currentTime >= seconds(data.begin, -Infinity) && currentTime < seconds(data.end, Infinity);
      const at = point && isNow ? pixelOf(camera, point) : null;
      if (!at || at.x < 0 || at.y < 0 || at.x > width || at.y > height) {
        this.#hide(slot);
        continue;
      }
      slot.hidden = false;
      slot.style.transform = `translate(${at.x / width * clientWidth}px, ${at.y / height * clientHeight}px) translate(-50%, -50%)`;
      slot.style.zIndex = String(Math.round(1e6 / (1 + at.depth)));  // the nearer ones are in front
    }
  }

  /** Nothing is shown. */
  hide() { for (const {slot} of this.spots.values()) this.#hide(slot); }

  /** @param {HTMLSlotElement} slot */
  #hide(slot) {
    // Who is on it with the keyboard stays in the player.
    if (!slot.hidden && slot.assignedElements().some(element => element.contains(document.activeElement))) {
      this.player.shadowRoot?.querySelector('canvas')?.focus();
    }
    slot.hidden = true;
  }
}
