// SPDX-License-Identifier: Apache-2.0
// The worker of a movie: a session, driven by messages (movie.js).
import {fetchError, L4DError} from './errors.js';
import {compile} from './decoder.js';
import {Presentation} from './presentation.js';
import {Session} from './session.js';
import {BlobSource, BufferSource, HttpSource} from './sources.js';

/** @type {any} */
const scope = globalThis;
/** @type {Session | Presentation | null} */
let session = null;
/** @type {Map<number, AbortController>} */
const running = new Map();
/** What the page is asked before requests. @type {((answer: any) => void)[]} */
const asked = [];

/** @param {any} message @param {Transferable[]} [transfer] */
const post = (message, transfer) => scope.postMessage(message, transfer ?? []);

const onRetry = (/** @type {string} */ message) => post({type: 'retry', message});

/** @param {import('./link.js').Request} request @returns {Promise<import('./link.js').Request>} */
const askPage = request => new Promise((resolve, reject) => {
  const id = asked.push(({error, ...changes}) => error ? reject(L4DError.fromData(error)) : resolve({...request, ...changes})) - 1;
  post({type: 'request', id, request});
});

/** @param {any} from @param {import('./link.js').LinkOptions} link */
const sourceOf = ({url, blob, buffer}, link) =>
  buffer ? new BufferSource(buffer) : blob ? new BlobSource(blob) : new HttpSource(url, link);

/** @param {string} url @param {AbortSignal} signal */
const fetchWasm = (url, signal) => fetch(url, {signal}).catch(error => {
  throw error?.name === 'AbortError' ? error : fetchError(url, error);
});

/** @type {Record<string, (message: any, signal: AbortSignal) => Promise<[any, Transferable[]?]>>} */
const answers = {
  async open(message, signal) {
    // While it compiles, the first bytes come.
    const wasm = compile(message.wasm ?? fetchWasm(message.wasmUrl, signal));
    const {source, options, asks} = message;
    const link = {...message.link, onRetry, request: asks ? askPage : undefined};
    session = message.isPlaylist ? new Presentation(wasm, source.url, post, {...options, ...link}) :
      new Session(wasm, sourceOf(source, link), post, options);
    return [await session.open(signal)];
  },
  async slice({time, options}, signal) {
    const slice = await /** @type {Session | Presentation} */ (session).slice(time, options, signal);
    const arrays = [slice.position, slice.covariance, slice.opacity];
    if (slice.sh) arrays.push(slice.sh);
    return [slice, arrays.map(a => a.buffer)];
  },
  async statistics() { return [session?.statistics()]; }
};

scope.onmessage = async (/** @type {MessageEvent} */ {data}) => {
  if (data.type === 'want') return session?.want(data.goal, data.seek);
  if (data.type === 'refresh') {
    // What is ready from here on has been sent again.
    post({type: 'refreshed'});
    return session?.refresh();
  }
  if (data.type === 'requested') {
    asked[data.id](data.answer);
    return delete asked[data.id];
  }
  if (data.type === 'abort') return running.get(data.id)?.abort();
  if (data.type === 'dispose') {
    session?.dispose();
    return scope.close();
  }
  const control = new AbortController();
  running.set(data.id, control);
  try {
    const [result, transfer] = await answers[data.type](data, control.signal);
    post({type: 'answer', id: data.id, result}, transfer);
  } catch (error) {
    post({type: 'answer', id: data.id, error: L4DError.toData(error)});
  } finally {
    running.delete(data.id);
  }
};
