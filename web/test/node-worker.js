// SPDX-License-Identifier: Apache-2.0
// web/core/src/worker.js as a worker thread of node, with the messages of a worker of a page.
import {readFileSync} from 'node:fs';
import {parentPort} from 'node:worker_threads';

const port = /** @type {import('node:worker_threads').MessagePort} */ (parentPort);
/** @type {any} */
const scope = globalThis;
scope.postMessage = (/** @type {any} */ message, /** @type {any[]} */ transfer) => port.postMessage(message, transfer);
scope.close = () => process.exit(0);
const {fetch} = globalThis;
scope.fetch = (/** @type {any} */ url, /** @type {any} */ options) => String(url).startsWith('file:') ?
  Promise.resolve(new Response(readFileSync(new URL(url)))) : fetch(url, options);
// What comes before the worker listens waits, as in a page.
/** @type {any[]} */
const early = [];
port.on('message', data => { scope.onmessage ? scope.onmessage({data}) : early.push(data); });
await import('../core/src/worker.js');
for (const data of early.splice(0)) scope.onmessage({data});
