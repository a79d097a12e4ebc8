// SPDX-License-Identifier: Apache-2.0
// How workers start: beside the page, from another origin, and out of the text of one file.

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

/** Of any origin. @param {string | URL} address */
export const workerFrom = address => {
  const url = new URL(address, globalThis.location?.href);
  const isHere = url.origin === globalThis.location?.origin;
  // Browsers start workers from the origin of the page alone, but those may load others.
  return isHere ? new Worker(trustedUrl(url.href), {type: 'module'}) : fromText(`import ${JSON.stringify(url.href)};`);
};

/**
 * @param {() => Worker} make with the words that bundlers look for @param {string | undefined} text
 * @param {string} name of the file @param {string} base of the module
 */
export const startWorker = (make, text, name, base) => {
  if (text !== undefined) return fromText(text);
  try {
    return make();
  } catch (error) {
    // Another origin, or trusted types.
    if (!base.startsWith('http')) throw error;
    return workerFrom(new URL(name, base));
  }
};
