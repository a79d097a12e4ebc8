// SPDX-License-Identifier: Apache-2.0
// What attributes of <l4d-player> say of open().
import {L4DError, workerFrom} from 'l4dcodec';

/** @param {string} text @returns {Record<string, string>} */
const headersOf = text => {
  try {
    return JSON.parse(text);
  } catch {
    throw new L4DError('INVALID_ARGUMENT', 'the attribute headers is no JSON; it must be as {"name": "value"}');
  }
};

/** "distance=4 slowest=0.9": numbers by name. @param {string} text @returns {import('l4dcodec').LiveOptions} */
const liveOf = text => Object.fromEntries(text.split(/\s+/).filter(Boolean).map(word => {
  const [name, value] = word.split('=');
  return [name, Number(value)];
}));

/** @param {HTMLElement & {options?: import('l4dcodec').OpenOptions}} player @returns {import('l4dcodec').OpenOptions} */
export const openOptions = player => {
  /** @template T @param {string} name @param {(text: string) => T} read @returns {T | undefined} */
  const of = (name, read) => {
    const text = player.getAttribute(name);
    return text === null ? undefined : read(text);
  };
  /** @type {import('l4dcodec').OpenOptions} */
  const stated = {
    bases: of('bases', text => text.split(/\s+/).filter(Boolean)), cache: of('cache', text => /** @type {RequestCache} */ (text)),
    cacheBytes: of('cache-bytes', Number),
    credentials: of('crossorigin', text => text === 'use-credentials' ? 'include' : 'same-origin'),
    headers: of('headers', headersOf), live: of('live', liveOf), maxRows: of('max-rows', Number), playlist: of('playlist', text => text !== 'false'),
    retries: of('retries', Number), timeout: of('timeout', Number), tolerant: of('tolerant', text => text !== 'false'),
    wasmUrl: of('wasm-src', text => text), worker: of('worker-src', text => () => workerFrom(text))
  };
  const given = Object.entries(stated).filter(([, value]) => value !== undefined);
  return {...Object.fromEntries(given), ...player.options};
};
