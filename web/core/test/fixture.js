// SPDX-License-Identifier: Apache-2.0
// What tests share: l4d.wasm (L4D_WASM), the native tool (L4D_TOOL) and streams (L4D_STREAMS).
import {execFileSync} from 'node:child_process';
import {readFileSync} from 'node:fs';
import {decoderAt as decoderOver} from '../../test/at-hand.js';
import {compile, Decoder} from '../src/decoder.js';
import {Engine} from '../src/engine.js';

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

/** @param {Uint8Array} bytes @param {[number?, any?, any?]} rest as of at-hand.js */
export const decoderAt = (bytes, ...rest) => decoderOver(wasm, bytes, ...rest);

/**
 * An engine in this thread, and what it posts.
 * @param {any} link @param {any} [options] @param {string} [url]
 */
export const engineOf = async (link, {slices, ...options} = /** @type {any} */ ({}), url = 'http://127.0.0.1/scene.l4d') => {
  /** @type {any[]} */
  const posts = [];
  const engine = new Engine(await Decoder.create(wasm, {...options, slices}), link, url, message => posts.push(message), {...options, slices});
  const of = (/** @type {string} */ type) => posts.filter(p => p.type === type);
  /** The last state. */
  const state = () => of('state').at(-1) ?? {};
  return {engine, posts, of, state};
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
