// SPDX-License-Identifier: Apache-2.0
// The engine over bytes that are at hand, driven without a clock and without a thread.
import {all, Decoder} from '../core/src/decoder.js';

/**
 * A decoder of a stream at an instant, the loads that its engine asks for there, events, the last state, and how many bytes it wanted.
 * @param {WebAssembly.Module} wasm @param {Uint8Array} bytes @param {number} [share] of the duration
 * @param {any} [options] of Decoder.create; `whole`: all that follows is loaded, too; `at`: seconds, in place of the share
 * @param {{maxTier?: number, detail?: number}} [quality]
 */
export const decoderAt = async (wasm, bytes, share = 0, {whole = false, at = NaN, ...options} = {}, {maxTier = all, detail = 0} = {}) => {
  const decoder = await Decoder.create(wasm, {...options, ...whole && {ahead: 600}});
  /** @type {import('../core/src/decoder.js').Item[]} */
  const loads = [], events = [];
  let now = 0, received = 0;
  /** @param {import('../core/src/decoder.js').Item} item */
  const answer = item => {
    const {kind, id, offset, size} = item;
    if (kind === 1) {
      const part = bytes.subarray(offset, size > 0 ? offset + size : bytes.length);
      decoder.call('answered', now, id, 206, offset, bytes.length, 1, 0);
      decoder.received(now, id, part);
      decoder.call('finished', now, id, 0);
      received += part.length;
    } else if (kind === 3) {
      loads.push(item);
      decoder.call('loaded', now, id, item.units, 0);
    } else if (kind === 5) {
      events.push(item);
    }
  };
  const run = () => {
    for (;;) {
      const {state, items} = decoder.update(now += 0.01);
      items.forEach(answer);
      if (items.length === 0) return state;
    }
  };
  decoder.open(now, 'scene.l4d', false);
  decoder.call('set_quality', now, all, maxTier, detail, 1, whole ? 0 : 1);
  const {begin, end} = run();
  loads.length = 0;
  const time = Number.isNaN(at) ? begin + share * (end - begin) : at;
  decoder.call('command', now, 3);
  decoder.call('seek', now, time, 0, 1);
  const state = run();
  return {decoder, loads, events, state, time, received};
};
