// SPDX-License-Identifier: Apache-2.0
// What a movie makes of the messages of its worker.
import assert from 'node:assert/strict';
import {test} from 'node:test';
import {L4DError, open} from '../src/index.js';

/** A worker that opens a stream of 8 s, and says what tests say. */
const workerOf = () => {
  const worker = {
    /** @type {any[]} */
    messages: [],
    /** @type {((event: any) => void) | null} */
    onmessage: null,
    onerror: null,
    /** @param {any} message */
    postMessage(message) {
      worker.messages.push(message);
      const result = {timeBegin: 0, duration: 8, numFrames: 240, rateNumerator: 30, rateDenominator: 1, maxRows: 256, lastTier: 2};
      if (message.type === 'open') queueMicrotask(() => worker.say({type: 'answer', id: message.id, result}));
    },
    /** @param {any} data */
    say(data) { worker.onmessage?.({data}); },
    /** The last goal. */
    goal: () => worker.messages.findLast(m => m.type === 'want').goal,
    /** @param {any} goal @param {any} more */
    ready: ({id, turn, time}, more) => worker.say({type: 'ready', id, turn, from: time, until: time + 1, ...more})
  };
  return worker;
};

const openWith = async (/** @type {any} */ worker, options = {}) =>
  open(new ArrayBuffer(8), {worker: () => worker, wasmUrl: 'http://localhost/l4d.wasm', ...options});

/** @param {() => any} fn */
const failureOf = async fn => {
  try {
    await fn();
    return 'none';
  } catch (error) {
    return error instanceof L4DError ? error.code : /** @type {any} */ (error).name;
  }
};

test('wrong values are refused at once, and change nothing', async () => {
  const worker = workerOf();
  const movie = await openWith(worker);
  const sent = worker.messages.length;
  /** @type {any} */
  const any = movie;
  for (const value of [-1, 0.5, NaN, '1', null, undefined, -Infinity]) {
    assert.equal(await failureOf(() => { any.maxTier = value; }), 'INVALID_ARGUMENT', `${value}`);
    assert.equal(await failureOf(() => { any.maxLevel = value; }), 'INVALID_ARGUMENT', `${value}`);
    if (value !== undefined) assert.equal(await failureOf(() => any.slice(1, {maxTier: value})), 'INVALID_ARGUMENT', `${value}`);
  }
  for (const value of ['', 'Full', 'none', 0, null, undefined]) {
    assert.equal(await failureOf(() => { any.detail = value; }), 'INVALID_ARGUMENT', `${value}`);
    assert.equal(await failureOf(() => any.setDetail(value)), 'INVALID_ARGUMENT', `${value}`);
  }
  assert.equal(await failureOf(() => any.slice(1, {detail: 'auto'})), 'INVALID_ARGUMENT');
  assert.equal(await failureOf(() => any.slice(NaN)), 'INVALID_ARGUMENT');
  assert.equal(worker.messages.length, sent);
  assert.deepEqual([movie.detail, movie.maxTier, movie.maxLevel], ['auto', 2 ** 32 - 1, 2 ** 32 - 1]);
  movie.maxTier = 1;
  movie.maxLevel = Infinity;
  movie.detail = 'base';
  const {maxTier, maxLevel, detail} = worker.goal();
  assert.deepEqual([maxTier, maxLevel, detail], [1, 2 ** 32 - 1, 'base']);
  movie.dispose();
});

test('what open() and a movie fail with: an L4DError with a code, or an AbortError', async () => {
  const codes = [];
  for (const cacheBytes of [-1, NaN, '5', null]) codes.push(await failureOf(() => openWith(workerOf(), {cacheBytes})));
  assert.deepEqual(codes, Array(4).fill('INVALID_ARGUMENT'));
  for (const maxRows of [-1, NaN]) assert.equal(await failureOf(() => openWith(workerOf(), {maxRows})), 'INVALID_ARGUMENT');
  /** @type {any} */
  const wrong = ['http://[', 'scene.l4d', 7, null, undefined, {}];
  for (const from of wrong) {
    assert.equal(await failureOf(() => open(from, {worker: /** @type {any} */ (workerOf)})), 'INVALID_ARGUMENT', `${from}`);
  }
  const control = new AbortController();
  const movie = await openWith(workerOf());
  const seeking = failureOf(() => movie.seek(1, {signal: control.signal}));
  control.abort();
  assert.equal(await seeking, 'AbortError');
  assert.equal(await failureOf(() => movie.seek(2, {signal: control.signal})), 'AbortError');
  assert.equal(await failureOf(() => openWith(workerOf(), {signal: control.signal})), 'AbortError');
  const slicing = failureOf(() => movie.slice(1));
  const other = failureOf(() => movie.seek(1));
  movie.dispose();
  assert.deepEqual([await slicing, await other, await failureOf(() => movie.seek(1))], ['AbortError', 'AbortError', 'AbortError']);
  try {
    await movie.slice(1);
    assert.fail('a slice of a movie that is gone');
  } catch (error) {
    assert.ok(error instanceof DOMException);
  }
});

test('the failure of an instant does not end the seek to the next one', async () => {
  const worker = workerOf();
  const movie = await openWith(worker);
  /** @type {any[]} */
  const heard = [];
  movie.on('error', error => heard.push(error.code));
  const fail = (/** @type {any} */ goal) => worker.say({type: 'error', id: goal?.id, turn: goal?.turn,
                                                        error: {code: 'NETWORK', message: 'gone', clause: '', offset: -1}});
  const first = worker.goal();
  const seeking = movie.seek(6);
  fail(first);
  assert.deepEqual(heard, []);
  worker.ready(worker.goal(), {detail: 'base', tier: 0});
  await seeking;
  const other = failureOf(() => movie.seek(2));
  fail(worker.goal());
  assert.equal(await other, 'NETWORK');
  // Of a playlist that is followed.
  fail(null);
  assert.deepEqual(heard, ['NETWORK', 'NETWORK']);
  movie.dispose();
});

test('losses are told, and kept for who comes later', async () => {
  const worker = workerOf();
  const movie = await openWith(worker);
  /** @type {any[]} */
  const heard = [];
  movie.on('loss', losses => heard.push(...losses));
  const loss = {code: 'TRUNCATED', clause: 'CHNK-1', offset: 4096, layer: 1, bucket: 0, gaussians: 7, detailOnly: false};
  worker.say({type: 'loss', losses: [loss]});
  worker.say({type: 'loss', losses: [{...loss, offset: 8192}]});
  assert.deepEqual(heard.map(l => l.offset), [4096, 8192]);
  assert.deepEqual(movie.losses, heard);
  movie.dispose();
});

test('what was ready of an earlier instant or tier does not count for the next one', async () => {
  const worker = workerOf();
  const movie = await openWith(worker);
  /** @type {any[]} */
  const heard = [];
  movie.on('ready', ready => heard.push(ready));
  const first = worker.goal();
  const seeking = movie.seek(6);
  const second = worker.goal();
  // On its way while the movie seeks.
  worker.ready({...first, time: 6}, {detail: 'full', tier: 2});
  assert.deepEqual([heard, movie.ready.detail, movie.secondsAhead], [[], 'none', 0]);
  worker.ready(second, {detail: 'base', tier: 0});
  await seeking;
  assert.deepEqual(heard.map(r => [r.from, r.detail, r.tier]), [[6, 'base', 0]]);
  movie.maxTier = 0;
  worker.ready(second, {detail: 'base', tier: 1});
  worker.ready(worker.goal(), {detail: 'full', tier: 0});
  assert.deepEqual(heard.slice(1).map(r => [r.detail, r.tier]), [['full', 0]]);
  // What is wanted while it plays goes on from there.
  movie.advance(6.5);
  worker.ready(worker.goal(), {detail: 'full', tier: 0});
  assert.equal(movie.ready.until, 7.5);
  movie.dispose();
});
