// SPDX-License-Identifier: Apache-2.0
// Browsers have few contexts for all canvases of a page (16 in Chromium) and drop the oldest one: players give theirs back before.

const most = 8;
/** @typedef {{isNear: boolean, sleep: () => void}} Member */
/** Those that draw, the one that was used longest ago first. @type {Set<Member>} */
const awake = new Set();

const hidden = () => [...awake].find(player => !player.isNear);

/** Whether one more can draw without taking the picture of one that is seen. */
export const hasRoom = () => awake.size < most || hidden() !== undefined;

/** @param {Member} player that draws from now on, or is used */
export const enter = player => {
  awake.delete(player);
  const [oldest] = awake;
  const victim = awake.size >= most ? hidden() ?? oldest : undefined;
  awake.add(player);
  victim?.sleep();
};

/** @param {Member} player */
export const leave = player => { awake.delete(player); };
