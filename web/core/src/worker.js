// SPDX-License-Identifier: Apache-2.0
// The worker of a movie: an engine, driven by messages (movie.js), and one for slices, once somebody wants some.
import {fetchError, L4DError} from './errors.js';
import {compile, Decoder} from './decoder.js';
import {Engine} from './engine.js';
import {Link, LocalLink} from './link.js';

/** @type {any} */
const scope = globalThis;
/** @type {Engine | null} */
let engine = null;
/** @type {Promise<Engine> | null} */
let slicer = null;
/** Makes an engine as that of the movie. @type {(post: any, options?: any) => Promise<Engine>} */
let makeEngine;
/** @type {Map<number, AbortController>} */
const running = new Map();
/** What the page is asked before requests. @type {((answer: any) => void)[]} */
const asked = [];
const slicerBytes = 64 * 2 ** 20;  // of the file, that slices keep

/** @param {any} message @param {Transferable[]} [transfer] */
const post = (message, transfer) => scope.postMessage(message, transfer ?? []);

/** @param {import('./link.js').Request} request @returns {Promise<import('./link.js').Request>} */
const askPage = request => new Promise((resolve, reject) => {
  const id = asked.push(({error, ...changes}) => error ? reject(L4DError.fromData(error)) : resolve({...request, ...changes})) - 1;
  post({type: 'request', id, request});
});

/** @param {any} from @param {import('./link.js').LinkOptions} options */
const linkOf = ({url, blob, buffer}, options) => url ? new Link(url, options) : new LocalLink(blob ?? buffer);

/** @param {string} url @param {AbortSignal} signal */
const fetchWasm = (url, signal) => fetch(url, {signal}).catch(error => {
  throw error?.name === 'AbortError' ? error : fetchError(url, error);
});

/** @type {Record<string, (message: any, signal: AbortSignal) => Promise<[any, Transferable[]?]>>} */
const answers = {
  async open({wasm, wasmUrl, source, link, asks, isPlaylist, options}, signal) {
    const linked = linkOf(source, {...link, request: asks ? askPage : undefined});
    // While it compiles, the first bytes come.
    if (linked instanceof Link) linked.begin(isPlaylist, signal);
    /** @type {WebAssembly.Module | WebAssembly.Instance} */
    let code = await compile(wasm ?? fetchWasm(wasmUrl, signal));
    makeEngine = async (to, more) => {
      const decoder = await Decoder.create(code, {...options, ...more});
      code = decoder.instance;
      return new Engine(decoder, linked, source.url ?? '', to, {...options, ...more, isPlaylist});
    };
    engine = await makeEngine(post);
    return [await engine.open(signal)];
  },
  async slice({time, options}, signal) {
    // The page hears what it loses; all else is of the page's own engine.
    slicer ??= makeEngine((/** @type {any} */ message) => { if (message.type === 'loss') post(message); },
                          {slices: true, preload: 'auto', ahead: 0.5, cacheBytes: Math.min(options.cacheBytes ?? Infinity, slicerBytes)}).then(async made => {
      await made.open();
      return made;
    });
    const slice = await (await slicer.catch(error => { slicer = null; throw error; })).slice(time, options, signal);
    const arrays = [slice.position, slice.covariance, slice.opacity];
    if (slice.sh) arrays.push(slice.sh);
    return [slice, arrays.map(a => a.buffer)];
  },
  async statistics() { return [engine?.statistics()]; }
};

/** Commands of the page. @type {Record<string, (engine: Engine, message: any) => void>} */
const commands = {
  play: e => e.command('play'),
  pause: e => e.command('pause'),
  retry: e => e.command('retry'),
  seek: (e, {time, id, tolerance}) => e.seek(time, id, tolerance),
  motion: (e, {rate, mode}) => e.setMotion(rate, mode),
  quality: (e, {quality}) => e.setQuality(quality),
  refresh(e) {
    // What is ready from here on has been sent again.
    post({type: 'refreshed'});
    e.command('refresh');
  }
};

scope.onmessage = async (/** @type {MessageEvent} */ {data}) => {
  if (commands[data.type]) {
    if (!engine) return;
    engine.turn = data.turn;
    return commands[data.type](engine, data);
  }
  if (data.type === 'requested') {
    asked[data.id](data.answer);
    return delete asked[data.id];
  }
  if (data.type === 'abort') return running.get(data.id)?.abort();
  if (data.type === 'dispose') {
    engine?.dispose();
    void slicer?.then(made => made.dispose(), () => {});
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
