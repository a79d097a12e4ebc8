// SPDX-License-Identifier: Apache-2.0
// How workers start: beside the page, from another origin, and out of the text of one file; and why one does not.
import {fetchError, fileError, L4DError, statusError} from './errors.js';

/**
 * What a file holds that has all of the player in it (l4d-player.js): texts of workers, bytes of l4d.wasm.
 * @type {{worker?: string, sortWorker?: string, wasm?: Uint8Array<ArrayBuffer>}}
 */
export const inlined = {};

/** For pages that demand trusted types: all that goes through it is the player's own. @type {any} */
const policy = /** @type {any} */ (globalThis).trustedTypes?.createPolicy('l4dcodec', {
  createHTML: (/** @type {string} */ html) => html, createScriptURL: (/** @type {string} */ url) => url
});
/** @param {string} html @returns {string} */
export const trustedHtml = html => policy?.createHTML(html) ?? html;
/** @param {string} url @returns {string} */
const trustedUrl = url => policy?.createScriptURL(url) ?? url;

/** @param {string} text of a module */
const fromText = text => {
  const url = URL.createObjectURL(new Blob([text], {type: 'text/javascript'}));
  const worker = new Worker(trustedUrl(url), {type: 'module'});
  // Once it has loaded: Chromium fetches it later than the constructor returns.
  setTimeout(() => URL.revokeObjectURL(url), 60000);
  return worker;
};

/** Where the files of workers lie. @type {WeakMap<Worker, string>} */
const addresses = new WeakMap();
// Its worker tells a page as little of a policy as of a missing file.
let isForbidden = false;
globalThis.document?.addEventListener('securitypolicyviolation', ({effectiveDirective}) => {
  if (effectiveDirective === 'worker-src') isForbidden = true;
});

/** @param {Worker} worker @param {string} address */
const lies = (worker, address) => {
  addresses.set(worker, address);
  return worker;
};

/** Of any origin. @param {string | URL} address */
export const workerFrom = address => {
  const url = new URL(address, globalThis.location?.href);
  const isHere = url.origin === globalThis.location?.origin;
  // Browsers start workers from the origin of the page alone, but those may load others.
  return lies(isHere ? new Worker(trustedUrl(url.href), {type: 'module'}) : fromText(`import ${JSON.stringify(url.href)};`), url.href);
};

/**
 * @param {() => Worker} make with the words that bundlers look for @param {string | undefined} text
 * @param {string} name of the file @param {string} base of the module
 */
export const startWorker = (make, text, name, base) => {
  if (text !== undefined) return fromText(text);
  const {origin} = globalThis.location ?? {};
  // Chromium throws where the worker is of another origin, and Firefox fails later.
  if (base?.startsWith('http') && new URL(base).origin !== origin) return workerFrom(new URL(name, base));
  try {
    return lies(make(), new URL(name, base).href);
  } catch (error) {
    // Trusted types.
    if (!base.startsWith('http')) throw error;
    return workerFrom(new URL(name, base));
  }
};

/**
 * Why a worker has failed. Browsers do not say of a file whether the server lacks it: a request does.
 * @param {Worker} worker @param {{message?: string}} event of its `onerror` @returns {Promise<L4DError>}
 */
export const workerError = async (worker, {message}) => {
  if (message) return new L4DError('INTERNAL', message);
  if (globalThis.location?.protocol === 'file:') return fileError('starts no workers');
  const url = addresses.get(worker);
  /** @type {any} */
  const answer = url && await fetch(url).catch(error => fetchError(url, error));
  if (url && !isForbidden) {
    if (answer instanceof L4DError) return answer;
    if (!answer.ok) return statusError(url, answer.status);
    const type = answer.headers.get('Content-Type') ?? '';
    // What servers of applications send in place of what they do not have.
    if (!type.includes('script')) return new L4DError('NOT_FOUND', `${url}: this is '${type}' and no script; check the address`);
  }
  return new L4DError('INTERNAL', `${url ?? 'the worker'} did not start; a content security policy must allow it (worker-src)`);
};
