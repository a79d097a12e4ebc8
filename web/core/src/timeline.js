// SPDX-License-Identifier: Apache-2.0

/**
 * @typedef {{timeBegin: number, duration: number, numFrames: number, rateNumerator: number, rateDenominator: number}} Timeline
 */
/** @typedef {{stream: number, time: number, frame: number}} StreamTime an instant of a stream, in its own time */

/**
 * The frame that a time belongs to, as section 15.6 of the specification computes it. Gaussians with a flat window are
 * seen in the frames from `begin` to `end` - 1: in rows, the last two numbers are `begin` and `-end`.
 * @param {{timeBegin: number, numFrames: number, rateNumerator: number, rateDenominator: number}} info of a stream
 * @param {number} time seconds
 */
export const frameOfTime = ({timeBegin, numFrames, rateNumerator, rateDenominator}, time) => {
  const frames = (time - timeBegin) * rateNumerator / rateDenominator;
  // Times of frames are in general no binary fractions, and may be a little early.
  return frames > 0 ? Math.min(Math.floor(frames + 2 ** -11), numFrames - 1) : 0;
};
