// SPDX-License-Identifier: Apache-2.0
import {L4DError} from 'l4dcodec';

const mostPixels = 4096;  // of a side

/** A canvas with a picture. @param {Uint8Array} pixels [height, width, 4] @param {number} width @param {number} height */
export const canvasOf = (pixels, width, height) => {
  const canvas = Object.assign(document.createElement('canvas'), {width, height});
  canvas.getContext('2d')?.putImageData(new ImageData(new Uint8ClampedArray(pixels), width, height), 0, 0);
  return canvas;
};

/**
 * @typedef {object} PictureOptions
 * @property {string} [type] image/png (default), image/jpeg or image/webp
 * @property {number} [quality] 0 to 1, of those that lose something
 * @property {number} [width] pixels, up to 4096: those of the canvas, or what the height and its shape make of them
 * @property {number} [height]
 */

/** What a view shows, settled. @param {import('./view.js').View} view @param {PictureOptions} options */
export const pictureOf = async (view, {type, quality, width, height}) => {
  for (const size of [width, height]) {
    if (size === undefined || Number.isInteger(size) && size > 0 && size <= mostPixels) continue;
    throw new L4DError('INVALID_ARGUMENT', `the size of a picture is 1 to ${mostPixels} pixels, not ${size}`);
  }
  const {canvas} = view;
  const shape = canvas.clientWidth / Math.max(canvas.clientHeight, 1);
  const other = (/** @type {number | undefined} */ size, /** @type {number} */ share) =>
    size && Math.min(Math.max(Math.round(size * share), 1), mostPixels);
  const [w, h] = [width ?? other(height, shape), height ?? other(width, 1 / shape)];
  const pixels = await view.pixels(w, h);
  const picture = canvasOf(pixels, w ?? canvas.width, h ?? canvas.height);
  return new Promise((/** @type {(blob: Blob) => void} */ resolve, reject) => {
    const take = (/** @type {Blob | null} */ blob) =>
      blob ? resolve(blob) : reject(new DOMException('the picture cannot be encoded', 'EncodingError'));
    picture.toBlob(take, type, quality);
  });
};
