// SPDX-License-Identifier: Apache-2.0
// What tests share: l4d.wasm (L4D_WASM), the native tool (L4D_TOOL) and streams (L4D_STREAMS).
import {execFileSync} from 'node:child_process';
import {readFileSync} from 'node:fs';
import {compile, Decoder} from '../src/decoder.js';
import {ByteStore} from '../src/store.js';

const need = name => {
  const value = process.env[name];
  if (!value) throw new Error(`${name} is not set: run web/test/run.sh`);
  return value;
};

export const tool = need('L4D_TOOL');
export const streams = need('L4D_STREAMS').split(':');
/** One of them. @param {string} name */
export const streamOf = name => streams.find(path => path.endsWith(`/${name}.l4d`)) ?? '';
export const wasmBytes = readFileSync(need('L4D_WASM'));
export const wasm = await compile(wasmBytes);

/** @param {string} name */
export const read = name => {
  const bytes = readFileSync(name);
  return new Uint8Array(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length));
};

/** A decoder over all bytes of a stream. @param {Uint8Array} bytes @param {any} [options] */
export const decoderOf = async (bytes, options) => {
  const store = new ByteStore();
  store.size = bytes.length;
  store.supply(0, bytes);
  return Decoder.create(wasm, store, options);
};

/** What the native tool prints as JSON. @param {...string} args */
export const native = (...args) => JSON.parse(execFileSync(tool, [...args, '--json'], {maxBuffer: 2 ** 28}).toString());

/** Waits until the condition holds. @param {() => boolean | Promise<boolean>} condition @param {string} what */
export const until = async (condition, what) => {
  for (const end = Date.now() + 60000; Date.now() < end;) {
    if (await condition()) return;
    await new Promise(resolve => setTimeout(resolve, 25));
  }
  throw new Error(`waited in vain for ${what}`);
};

/**
 * Timers of these lengths do not run while fn does, until it lets them: all others do, those of node and of its HTTP.
 * @param {number[]} lengths in ms @param {(timers: {lapse: () => void, lapsed: number[], onstart: () => void}) => Promise<void>} fn
 * lapse: ends those that run now; lapsed: how long they were; onstart: is called where one starts
 */
export const holdingTimers = async (lengths, fn) => {
  const {setTimeout: start, clearTimeout: clear} = globalThis;
  /** @type {Map<any, {ms: number, end: () => void}>} */
  const held = new Map();
  const timers = {
    lapse: () => {
      for (const [timer, {ms, end}] of [...held]) {
        held.delete(timer);
        timers.lapsed.push(ms);
        end();
      }
    },
    lapsed: /** @type {number[]} */ ([]), onstart: () => {}
  };
  globalThis.setTimeout = /** @type {any} */ ((/** @type {any} */ end, /** @type {any} */ ms, /** @type {any[]} */ ...given) => {
    if (!lengths.includes(ms)) return start(end, ms, ...given);
    const timer = {};
    held.set(timer, {ms, end: () => end(...given)});
    timers.onstart();
    return timer;
  });
  globalThis.clearTimeout = (/** @type {any} */ timer) => { if (!held.delete(timer)) clear(timer); };
  try {
    await fn(timers);
  } finally {
    Object.assign(globalThis, {setTimeout: start, clearTimeout: clear});
  }
};
