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
    /** The last message of a type. @param {string} type */
    last: type => worker.messages.findLast(m => m.type === type),
    /** What the engine is in after the last message. @param {any} more */
    state: more => {
      const {turn} = worker.messages.findLast(m => m.turn !== undefined);
      worker.say({type: 'state', turn, id: 0, isPlaying: false, isWaiting: false, hasEnded: false, from: 0, until: 1, time: 0,
                  at: (performance.timeOrigin + performance.now()) / 1000, velocity: 0, tier: 0, detail: 'base', ...more});
    },
    /** That a seek is answered. @param {any} seek @param {any} [more] */
    shown: ({id, time}, more) => {
      worker.say({type: 'shown', id});
      worker.state({id, time, from: time, until: time + 1, ...more});
    }
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
  assert.deepEqual(worker.last('quality').quality, {maxTier: 1, maxLevel: 2 ** 32 - 1, detail: 1});
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
  const fail = (/** @type {any} */ {id, turn} = {}) => worker.say({type: 'error', id, turn, error: {code: 'NETWORK', message: 'gone', clause: '', offset: -1}});
  const first = worker.last('seek');
  const seeking = movie.seek(6);
  fail(first);
  assert.deepEqual(heard, []);
  worker.shown(worker.last('seek'));
  await seeking;
  const other = failureOf(() => movie.seek(2));
  fail(worker.last('seek'));
  assert.equal(await other, 'NETWORK');
  assert.equal(movie.hasFailed, true);
  // Of a playlist that is followed.
  fail();
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
  const {turn} = worker.last('seek');
  const seeking = movie.seek(6);
  // On its way while the movie seeks.
  worker.state({turn, from: 6, until: 8, time: 6, detail: 'full', tier: 2});
  assert.deepEqual([heard, movie.ready.detail, movie.secondsAhead], [[], 'none', 0]);
  worker.shown(worker.last('seek'));
  await seeking;
  assert.deepEqual(heard.map(r => [r.from, r.detail, r.tier, r.id]), [[6, 'base', 0, worker.last('seek').id]]);
  movie.maxTier = 0;
  worker.state({turn: worker.last('seek').turn, from: 6, until: 8, time: 6, tier: 1});
  worker.state({from: 6, until: 8, time: 6});
  assert.deepEqual(heard.slice(1).map(r => [r.until, r.tier]), [[8, 0]]);
  assert.equal(movie.secondsAhead, 2);
  movie.dispose();
});

test('the page moves the time by what the worker said last, and only within what is ready', async () => {
  const worker = workerOf();
  const movie = await openWith(worker);
  const times = /** @type {number[]} */ ([]), heard = /** @type {string[]} */ ([]);
  const moved = (/** @type {number} */ n) => new Promise(resolve => { const end = movie.on('time', () => { if (times.length >= n) resolve(end()); }); });
  movie.on('time', time => times.push(time));
  for (const type of ['play', 'pause', 'ended', 'stall', 'resume']) movie.on(type, () => heard.push(type));
  movie.play();
  const sent = worker.messages.length;
  worker.state({isWaiting: true});
  // So slowly that the time does not run out, however long this thread waits for its turn.
  worker.state({isPlaying: true, velocity: 1e-4, time: 0, until: 0.1});
  await moved(3);
  worker.state({isPlaying: true, velocity: 1, time: 0.08, until: 0.1});
  await new Promise(resolve => { const end = movie.on('time', time => { if (time === 0.1) resolve(end()); }); });
  assert.ok(times.every((time, k) => time <= 0.1 && (k === 0 || time > times[k - 1])), `${times}`);
  // Nobody was asked meanwhile.
  assert.equal(worker.messages.length, sent);
  worker.state({isPlaying: true, velocity: -2, time: 5, from: 4.9, until: 6});
  await new Promise(resolve => { const end = movie.on('time', time => { if (time === 4.9) resolve(end()); }); });
  movie.pause();
  assert.deepEqual([movie.paused, movie.currentTime], [true, 4.9]);
  movie.play();
  worker.state({hasEnded: true, time: 8, from: 6, until: 8});
  assert.deepEqual([movie.paused, movie.currentTime], [true, 8]);
  assert.deepEqual(heard, ['play', 'stall', 'resume', 'pause', 'play', 'pause', 'ended']);
  // Again, from the beginning.
  movie.play();
  assert.equal(worker.last('seek').time, 0);
  movie.dispose();
});

test('a movie follows the time of a sound', async () => {
  const worker = workerOf();
  const movie = await openWith(worker);
  const media = {currentTime: 2, paused: false, playbackRate: 1.5};
  movie.sync(/** @type {any} */ (media));
  assert.equal(worker.last('motion').rate, 1.5);
  await new Promise(resolve => { const end = movie.on('time', time => { if (time === 2) resolve(end()); }); });
  assert.deepEqual([worker.last('seek').time, worker.last('play') !== undefined], [2, true]);
  // What the engine says of its own time is not shown.
  const seeks = worker.messages.filter(m => m.type === 'seek').length;
  worker.state({isPlaying: true, velocity: 1.5, time: 2.05, from: 2, until: 8});
  assert.equal(movie.currentTime, 2);
  media.currentTime = 2.1;
  await new Promise(resolve => { const end = movie.on('time', time => { if (time === 2.1) resolve(end()); }); });
  assert.equal(worker.messages.filter(m => m.type === 'seek').length, seeks, 'that is near enough');
  media.paused = true;
  media.currentTime = 7;
  await new Promise(resolve => { const end = movie.on('time', time => { if (time === 7) resolve(end()); }); });
  assert.ok(worker.last('pause'));
  movie.dispose();
});
