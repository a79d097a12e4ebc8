// SPDX-License-Identifier: Apache-2.0
// A movie of web/core in node: its worker is a thread.
import {pathToFileURL} from 'node:url';
import {Worker} from 'node:worker_threads';
import {open} from '../core/src/index.js';

/** What web/core asks of a worker. @returns {any} */
const threadWorker = () => {
  const thread = new Worker(new URL('./node-worker.js', import.meta.url));
  const worker = {
    /** @type {((event: any) => void) | null} */
    onmessage: null,
    /** @type {((event: any) => void) | null} */
    onerror: null,
    postMessage: (/** @type {any} */ message, /** @type {any[]} */ transfer) => thread.postMessage(message, transfer),
    terminate: () => thread.terminate()
  };
  thread.on('message', data => worker.onmessage?.({data}));
  thread.on('error', error => worker.onerror?.({message: String(error)}));
  return worker;
};

/** @param {string} url @param {string} wasm path of l4d.wasm @param {any} [options] as of open() */
export const openInNode = (url, wasm, options) =>
  open(url, {worker: threadWorker, wasmUrl: pathToFileURL(wasm).href, ...options});
