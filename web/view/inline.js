// SPDX-License-Identifier: Apache-2.0
// Before the element is defined, which may load at once.
import {inlined} from 'l4dcodec';
import sortWorker from 'inlined-sort-worker';
import wasm from 'inlined-wasm';
import worker from 'inlined-worker';

Object.assign(inlined, {sortWorker, wasm, worker});
