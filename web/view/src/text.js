// SPDX-License-Identifier: Apache-2.0
// What the player says.
import {words} from './words.js';

/** "1:02.5" @param {number} seconds */
export const clockText = seconds => {
  const tenths = Math.round(Math.max(seconds, 0) * 10);
  const minutes = Math.floor(tenths / 600);
  const hours = Math.floor(minutes / 60);
  const rest = `${String(Math.floor(tenths / 10) % 60).padStart(2, '0')}.${tenths % 10}`;
  return hours > 0 ? `${hours}:${String(minutes % 60).padStart(2, '0')}:${rest}` : `${minutes}:${rest}`;
};

/** "1 minute 2.5 seconds" @param {number} seconds @param {import('./words.js').Texts} texts */
export const spokenTime = (seconds, texts) => {
  const part = (/** @type {number} */ n, /** @type {string} */ unit) =>
    texts.number(n, {style: 'unit', unit, unitDisplay: 'long', maximumFractionDigits: 1});
  const minutes = Math.floor(seconds / 60);
  const rest = part(seconds - 60 * minutes, 'second');
  return minutes > 0 ? `${part(minutes, 'minute')} ${rest}` : rest;
};

/** @param {string} hash "#t=1.5&cam=...&player=ID" @returns {{time?: number, camera?: string, player?: string}} */
export const parseLink = hash => {
  const parts = new URLSearchParams(hash.replace(/^#/, ''));
  const time = Number(parts.get('t') ?? NaN);
  return {time: Number.isFinite(time) ? time : undefined, camera: parts.get('cam') ?? undefined, player: parts.get('player') ?? undefined};
};

/** Codes of errors that others have the words of. @type {Record<string, string>} */
const alike = {FEATURE_UNSUPPORTED: 'VERSION_UNSUPPORTED', CHECKSUM: 'CORRUPT'};

/** The word for an error, and what it says of its cause. @param {any} error */
export const describeError = error => {
  const code = alike[error?.code] ?? error?.code;
  return {title: code in words.en ? code : 'failed', text: String(error?.message ?? error)};
};

/**
 * What of a movie cannot be shown, "" if that is nothing.
 * @param {import('l4dcodec').Loss[]} losses @param {import('./words.js').Texts} texts
 */
export const describeLosses = (losses, texts) => {
  if (losses.length === 0) return '';
  const why = losses.some(loss => loss.code === 'TRUNCATED') ? 'TRUNCATED' : losses.some(loss => loss.begin !== undefined) ? 'gaps' : 'CORRUPT';
  const count = losses.filter(loss => !loss.detailOnly).length;
  const details = losses.length - count;
  return [texts.say(why), ...count > 0 ? [texts.say('hidden', {count})] : [], ...details > 0 ? [texts.say('plain', {count: details})] : []].join(' – ');
};

/**
 * The overlay: names and values.
 * @param {import('l4dcodec').Movie} movie @param {import('./view.js').View} view @param {number} fps @param {import('./words.js').Texts} texts
 * @returns {[string, string][]}
 */
export const overlayLines = (movie, view, fps, texts) => {
  const {bytes, throughput, lost, memoryBytes} = movie.statistics;
  const {maxLevel: level, ready: {detail, tier}, info: {fileBytes, lastTier}} = movie;
  const number = (/** @type {number} */ v, /** @type {number} */ digits = 0) =>
    texts.number(v, {minimumFractionDigits: digits, maximumFractionDigits: digits});
  const say = texts.say.bind(texts);
  const rungs = [say(/** @type {'none' | 'base' | 'full'} */ (detail)),
                 ...lastTier > 0 ? [say('of', {part: say('tier', {tier}), whole: lastTier})] : [], level > 1e9 ? say('levels') : say('level', {level})];
  return [
    [say('frames'), movie.paused && fps < 1 ? say('paused') : `${number(fps)} /s`],
    [say('splats'), number(view.stats.visible)],
    view.backend === 'webgpu' ? [`WebGPU: ${say('draw')}`, `${number(view.stats.drawMs, 1)} ms`] :
      [`WebGL2: ${say('sort')}`, `${number(view.stats.sortMs, 1)}, ${number(view.stats.drawMs, 1)} ms`],
    [say('network'), throughput > 0 ? `${number(throughput / 1e6, 1)} Mbit/s` : say('local')],
    [say('loaded'), `${say('of', {part: number(bytes / 1e6, 2), whole: number(fileBytes / 1e6, 2)})} MB`],
    [say('detail'), rungs.join(', ')],
    [say('buffer'), `${number(movie.secondsAhead, 1)} s`],
    [say('lost'), number(lost)],
    [say('memory'), `${number(memoryBytes / 1e6)} MB`]
  ];
};
