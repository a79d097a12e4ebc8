// SPDX-License-Identifier: Apache-2.0
// The bubble over the timeline: a time and its thumbnail, which a child <track kind="metadata" label="thumbnails"> names.
import {isAt} from './captions.js';
import {within} from './camera.js';
import {clockText} from './text.js';

const mostShare = 0.4;  // of the width and the height of the player

/** The image and the part of it that a cue names: "sprite.jpg#xywh=160,0,160,90". @param {string} text @param {string} base */
export const thumbnailOf = (text, base) => {
  const url = new URL(text.trim(), base);
  const [, ...part] = /xywh=(?:pixel:)?(\d+),(\d+),(\d+),(\d+)/.exec(url.hash) ?? [];
  url.hash = '';
  return {url: url.href, part: part.length > 0 ? part.map(Number) : null};
};

export class Preview {
  /** @param {import('./element.js').L4DPlayer} player */
  constructor(player) {
    this.player = player;
    this.share = 0;
    const timeline = player.$('.track');
    timeline.addEventListener('pointermove', (/** @type {PointerEvent} */ event) => {
      const {left, width} = timeline.getBoundingClientRect();
      this.show((event.clientX - left) / width);
    });
  }

  /** @param {number} share of the duration */
  show(share) {
    const {player, player: {movie}} = this;
    if (!movie) return;
    this.share = within(share, [0, 1]);
    const [bubble, timeline] = [player.$('.hover'), player.$('.track')];
    bubble.lastChild.textContent = clockText(this.share * movie.duration);
    this.#showThumbnail(within(this.share * movie.duration, [0, movie.duration - 1e-3]));  // the last cue ends with the scene
    const half = bubble.offsetWidth / 2;
    bubble.style.left = `${Math.max(Math.min(this.share * timeline.clientWidth, timeline.clientWidth - half), half)}px`;
  }

  /** @param {number} time */
  #showThumbnail(time) {
    const {player} = this;
    const box = player.$('.thumb');
    const track = player.captions.copyOf('metadata', 'thumbnails');
    if (track?.track.mode === 'disabled') {
      track.addEventListener('load', () => this.show(this.share), {once: true});
      track.track.mode = 'hidden';  // not fetched before a pointer is on the timeline
    }
    const cue = [...track?.track.cues ?? []].find(isAt(time));
    box.hidden = !cue;
    if (!track || !cue) return;
    const {url, part} = thumbnailOf(/** @type {VTTCue} */ (cue).text, track.src);
    const image = box.firstChild;
    if (image.src !== url) image.src = url;
    const [x, y, width, height] = part ?? [0, 0, 160, 90];
    const scale = Math.min(1, mostShare * player.clientWidth / width, mostShare * player.clientHeight / height);
    Object.assign(box.style, {width: `${scale * width}px`, height: part ? `${scale * height}px` : ''});
    Object.assign(image.style, {width: part ? '' : '100%', transform: part ? `scale(${scale}) translate(${-x}px, ${-y}px)` : ''});
  }
}
