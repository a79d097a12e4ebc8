// SPDX-License-Identifier: Apache-2.0
// Picture in picture of <l4d-player>: a <video> that nobody sees takes what is drawn, because browsers offer it for videos alone.

const events = /** @type {const} */ (['enterpictureinpicture', 'leavepictureinpicture']);

export const hasPictureInPicture = () =>
  Boolean(document.pictureInPictureEnabled) && typeof globalThis.HTMLCanvasElement.prototype.captureStream === 'function';

export class PictureInPicture {
  /** @param {import('./camera-element.js').CameraElement} player */
  constructor(player) {
    this.player = player;
    /** @type {HTMLVideoElement | null} */
    this.video = null;
    this.isOn = false;
  }

  /** Fails where the browser has none, where no scene is shown, and without a gesture of the reader. */
  async enter() {
    const {player, player: {view}} = this;
    if (!hasPictureInPicture()) throw new DOMException('this browser has no picture in picture', 'NotSupportedError');
    if (!view || !player.isOpen) throw new DOMException('no scene is shown', 'InvalidStateError');
    if (this.video) return this.video.requestPictureInPicture();
    const video = this.video = Object.assign(document.createElement('video'), {muted: true, srcObject: view.canvas.captureStream()});
    for (const type of events) video.addEventListener(type, event => this.#hear(type, /** @type {PictureInPictureEvent} */ (event)));
    try {
      view.change();  // or nothing would come
      await video.play();
      const window = await video.requestPictureInPicture();
      // Some browsers have buttons there.
      video.addEventListener('pause', () => player.pause());
      video.addEventListener('play', () => player.movie?.play());
      return window;
    } catch (error) {
      this.leave();
      throw error;
    }
  }

  /** @param {typeof events[number]} type @param {PictureInPictureEvent} event */
  #hear(type, {pictureInPictureWindow}) {
    this.isOn = type === events[0];
    if (!this.isOn) this.leave();
    this.player.dispatchEvent(new PictureInPictureEvent(type, {pictureInPictureWindow}));
  }

  leave() {
    const {video} = this;
    if (!video) return;
    this.video = null;
    for (const track of /** @type {MediaStream} */ (video.srcObject).getTracks()) track.stop();
    video.srcObject = null;
    if (this.isOn) void document.exitPictureInPicture().catch(() => {});
  }
}
