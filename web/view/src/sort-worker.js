// SPDX-License-Identifier: Apache-2.0
import {Sorter} from './sorter.js';

const sorter = new Sorter();
/** @type {Uint32Array[]} */
const spare = [];
/** @type {any} */
const scope = globalThis;

scope.onmessage = (/** @type {MessageEvent} */ {data}) => {
  if (data.type === 'add') sorter.add(data.key, data.geometry, data.lines, data.center, data.stream);
  else if (data.type === 'remove') sorter.remove(data.key);
  else if (data.type === 'clear') sorter.clear();
  else if (data.type === 'bounds') scope.postMessage({type: 'answer', answer: sorter.bounds(data.streams)});
  else if (data.type === 'pick') scope.postMessage({type: 'answer', answer: sorter.pick(data.sight, data.ray)});
  else if (data.type === 'return') spare.push(data.order);
  else if (data.type === 'sort') {
    const began = performance.now();
    const order = sorter.sort(data.sight, spare.pop() ?? null);
    const {visible: count, firstLines} = sorter;
    scope.postMessage({type: 'order', id: data.id, order, count, firstLines, ms: performance.now() - began}, [order.buffer]);
  }
};
