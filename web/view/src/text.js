// SPDX-License-Identifier: Apache-2.0
// What the player says.

/** "1:02.5" @param {number} seconds */
export const clockText = seconds => {
  const tenths = Math.round(Math.max(seconds, 0) * 10);
  const minutes = Math.floor(tenths / 600);
  const hours = Math.floor(minutes / 60);
  const rest = `${String(Math.floor(tenths / 10) % 60).padStart(2, '0')}.${tenths % 10}`;
  return hours > 0 ? `${hours}:${String(minutes % 60).padStart(2, '0')}:${rest}` : `${minutes}:${rest}`;
};

/** "1 minute 2.5 seconds" @param {number} seconds */
export const spokenTime = seconds => {
  const minutes = Math.floor(seconds / 60);
  const rest = Number((seconds - 60 * minutes).toFixed(1));
  const plural = (/** @type {number} */ n, /** @type {string} */ word) => `${n} ${word}${n === 1 ? '' : 's'}`;
  return minutes > 0 ? `${plural(minutes, 'minute')} ${plural(rest, 'second')}` : plural(rest, 'second');
};

/** @param {string} hash "#t=1.5&cam=...&player=ID" @returns {{time?: number, camera?: string, player?: string}} */
export const parseLink = hash => {
  const parts = new URLSearchParams(hash.replace(/^#/, ''));
  const time = Number(parts.get('t') ?? NaN);
  return {time: Number.isFinite(time) ? time : undefined, camera: parts.get('cam') ?? undefined, player: parts.get('player') ?? undefined};
};

/** @type {Record<string, string>} */
const titles = {
  NETWORK: 'The server does not answer', NOT_FOUND: 'The server does not have this file', HTTP: 'The server refuses this file',
  NO_RANGES: 'This server cannot send parts of this file', REQUEST: 'The page cannot ask for this file', CHANGED: 'The file has changed',
  NOT_L4D: 'This is no .l4d file', PLAYLIST: 'This playlist is damaged', VERSION_UNSUPPORTED: 'This file needs a newer player',
  FEATURE_UNSUPPORTED: 'This file needs a newer player', CORRUPT: 'This file is damaged', CHECKSUM: 'This file is damaged',
  TRUNCATED: 'This file is cut short', LIMIT_EXCEEDED: 'This file needs more memory than a page may use',
  OUT_OF_MEMORY: 'There is not enough memory', WEBGL2: 'This browser cannot draw the scene'
};

/** @param {any} error @returns {{title: string, text: string}} */
export const describeError = error => ({
  title: titles[error?.code] ?? 'This cannot be played',
  text: String(error?.message ?? error)
});

/**
 * What of a movie cannot be shown, "" if that is nothing.
 * @param {import('l4dcodec').Loss[]} losses
 */
export const describeLosses = losses => {
  const wants = losses.filter(loss => !loss.detailOnly).length;
  const parts = (/** @type {number} */ n) => n === 1 ? '1 part' : `${n} parts`;
  const why = losses.some(loss => loss.code === 'TRUNCATED') ? 'This file is cut short' :
    losses.some(loss => loss.begin !== undefined) ? 'Some of this recording is damaged or missing' : 'This file is damaged';
  const details = losses.length - wants;
  return losses.length === 0 ? '' : `${why}: ${[
    ...wants > 0 ? [`${parts(wants)} cannot be shown`] : [], ...details > 0 ? [`${parts(details)} without detail of colours`] : []
  ].join(', ')}`;
};

/**
 * The overlay: names and values.
 * @param {import('l4dcodec').Movie} movie @param {import('./view.js').View} view @param {number} fps
 * @returns {[string, string][]}
 */
export const overlayLines = (movie, view, fps) => {
  const {bytes, throughput, lost, memoryBytes} = movie.statistics;
  const number = (/** @type {number} */ v, /** @type {number} */ digits = 0) => v.toFixed(digits);
  return [
    ['frames', movie.paused && fps < 1 ? 'paused' : `${number(fps)} /s`],
    ['splats', Math.round(view.stats.visible).toLocaleString('en')],
    view.backend === 'webgpu' ? ['WebGPU: draw', `${number(view.stats.drawMs, 1)} ms`] :
      ['WebGL2: sort, draw', `${number(view.stats.sortMs, 1)}, ${number(view.stats.drawMs, 1)} ms`],
    ['network', throughput > 0 ? `${number(throughput / 1e6, 1)} Mbit/s` : 'local'],
    ['loaded', `${number(bytes / 1e6, 2)} of ${number(movie.info.fileBytes / 1e6, 2)} MB`],
    ['detail', `${movie.ready.detail}, ${movie.info.lastTier > 0 ? `tier ${movie.ready.tier} of ${movie.info.lastTier}, ` : ''}${movie.maxLevel > 1e9 ? 'all levels' : `level ${movie.maxLevel}`}`],
    ['buffer', `${number(movie.secondsAhead, 1)} s`],
    ['lost', String(lost)],
    ['memory', `${number(memoryBytes / 1e6)} MB`]
  ];
};

/** Of `Movie.liveState`, what people want to know. @type {Record<string, string>} */
export const liveTexts = {stale: 'Nothing new has come for a while', restarted: 'The recording began again'};
