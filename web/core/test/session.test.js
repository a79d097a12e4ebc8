// SPDX-License-Identifier: Apache-2.0
// Sessions over HTTP and over memory: what they fetch, what they say, what they survive.
import assert from 'node:assert/strict';
import {spawnSync} from 'node:child_process';
import {mkdtempSync, rmSync, writeFileSync} from 'node:fs';
import {tmpdir} from 'node:os';
import {join} from 'node:path';
import {mock, test} from 'node:test';
import {fetchError, L4DError} from '../src/errors.js';
import {Session} from '../src/session.js';
import {BlobSource, BufferSource, HttpSource} from '../src/sources.js';
import {blockBytes, ByteStore} from '../src/store.js';
import {read, streamOf, streams, tool, until, wasm} from './fixture.js';
import {serve} from './server.js';

const bytes = read(streams[0]);

/** @param {any} source @param {any} [options] */
const sessionOf = (source, options) => {
  /** @type {any[]} */
  const posts = [];
  const session = new Session(wasm, source, message => posts.push(message), options);
  const of = (/** @type {string} */ type) => posts.filter(p => p.type === type);
  return {session, posts, of};
};

/** Opens, seeks to the middle and waits for it; returns the held rows. */
const show = async (/** @type {any} */ source, options = {}) => {
  const s = sessionOf(source, options);
  const info = await s.session.open();
  s.session.want({time: info.timeBegin + info.duration / 2, ahead: 1, detail: 'auto', id: 7}, true);
  await until(() => s.of('ready').some(r => r.id === 7 && r.detail === 'full' && r.until > r.from) ||
    s.of('error').length > 0, 'the picture');
  return s;
};

/** Keys and rows of all full buckets. */
const rowsOf = (/** @type {any} */ s) => Object.fromEntries(s.of('rows').filter((/** @type {any} */ r) => r.detail === 0)
  .map((/** @type {any} */ r) => [r.key, r.count]));

test('store: whole blocks, gaps, pieces and a budget', () => {
  const store = new ByteStore(3 * blockBytes);
  store.size = 10 * blockBytes + 5;
  store.supply(blockBytes - 1, new Uint8Array(2 * blockBytes).fill(1));
  assert.deepEqual([...store.blocks.keys()], [1]);
  assert.equal(store.read(blockBytes + 3, new Uint8Array(10)), 10);
  assert.equal(store.read(2 * blockBytes - 3, new Uint8Array(10)), -1);
  assert.deepEqual(store.missed(), [[2 * blockBytes - 3, 10]]);
  assert.deepEqual(store.missing([[0, 3 * blockBytes]], 0), [[0, blockBytes], [2 * blockBytes, blockBytes]]);
  assert.deepEqual(store.missing([[0, 3 * blockBytes]]), [[0, 3 * blockBytes]]);
  assert.deepEqual(store.missing([[10 * blockBytes + 1, 100]]), [[10 * blockBytes, 5]]);
  store.supply(10 * blockBytes, new Uint8Array(5));
  assert.equal(store.read(10 * blockBytes + 2, new Uint8Array(10)), 3);
  assert.equal(store.read(store.size, new Uint8Array(10)), 0);
  // As few as one round of requests has: over the smallest gaps, and none that is too large.
  const places = [0, 2, 5, 9].map(k => /** @type {[number, number]} */ ([k * blockBytes, 10]));
  const sizes = (/** @type {number} */ few, /** @type {number} */ gap) =>
    store.missing(places, gap * blockBytes, 2 ** 20, few).map(([offset, size]) => [offset / blockBytes, size / blockBytes]);
  assert.deepEqual(sizes(6, 2), [[0, 1], [2, 1], [5, 1], [9, 1]]);
  assert.deepEqual(sizes(3, 2), [[0, 3], [5, 1], [9, 1]]);
  assert.deepEqual(sizes(2, 2), [[0, 6], [9, 1]]);
  assert.deepEqual(sizes(2, 1), [[0, 3], [5, 1], [9, 1]]);
  assert.deepEqual(sizes(6, 8), [[0, 3], [5, 1], [9, 1]]);
  store.supply(4 * blockBytes, new Uint8Array(3 * blockBytes));
  assert.deepEqual([...store.blocks.keys()], [4, 5, 6]);
});

test('store: what is used during a hold stays, whatever the budget', () => {
  const store = new ByteStore(0);
  store.size = 8 * blockBytes;
  const bytes = new Uint8Array(blockBytes);
  store.supply(0, bytes);
  assert.deepEqual([...store.blocks.keys()], []);
  const first = store.hold();
  store.supply(0, bytes);
  store.supply(2 * blockBytes, bytes);
  const second = store.hold();
  store.use([[0, 10]]);
  store.supply(5 * blockBytes, bytes);
  first();
  assert.deepEqual([...store.blocks.keys()], [0, 5]);
  second();
  assert.deepEqual([...store.blocks.keys()], []);
});

test('memory, a Blob and HTTP give the same rows', async () => {
  const server = await serve(bytes);
  try {
    const memory = await show(new BufferSource(bytes.slice().buffer));
    const blob = await show(new BlobSource(new Blob([bytes])));
    const http = await show(new HttpSource(server.url));
    assert.ok(Object.keys(rowsOf(memory)).length > 1);
    assert.deepEqual(rowsOf(blob), rowsOf(memory));
    assert.deepEqual(rowsOf(http), rowsOf(memory));
    assert.deepEqual(http.of('error'), []);
    // Base colours first.
    assert.equal(http.of('ready')[0].detail, 'base');
    for (const s of [memory, blob, http]) s.session.dispose();
  } finally {
    server.close();
  }
});

for (const cacheBytes of [0, 1, 20_000]) {
  test(`a cache of ${cacheBytes} bytes shows what a large one shows, with few requests`, async () => {
    const [server, whole] = [await serve(bytes), await serve(bytes, {ranges: false})];
    try {
      const wanted = await show(new HttpSource(server.url));
      const before = server.requests.length;
      const s = await show(new HttpSource(server.url), {cacheBytes});
      await until(() => !s.session.pumping, 'the end');
      assert.deepEqual(s.of('error'), []);
      assert.deepEqual(rowsOf(s), rowsOf(wanted));
      assert.ok(server.requests.length - before <= 3 * before, `${server.requests.length - before} requests, not ${before}`);
      assert.ok(s.session.store.bytes <= cacheBytes, `${s.session.store.bytes} bytes`);
      const slice = (/** @type {any} */ of) => of.session.slice(3, {}, of.session.control.signal);
      assert.deepEqual(await slice(s), await slice(wanted));
      // What is not sent again is kept.
      const kept = await show(new HttpSource(whole.url), {cacheBytes});
      assert.deepEqual(rowsOf(kept), rowsOf(wanted));
      assert.equal(whole.requests.length, 1);
      for (const one of [s, wanted, kept]) one.session.dispose();
    } finally {
      server.close();
      whole.close();
    }
  });
}

test('few requests bring the first picture, and no byte comes twice', async () => {
  const server = await serve(bytes);
  try {
    const s = await show(new HttpSource(server.url));
    const sum = server.requests.reduce((n, [, size]) => n + size, 0);
    assert.ok(server.requests.length <= 8, `${server.requests.length} requests`);
    assert.ok(sum <= bytes.length + 3 * blockBytes, `${sum} of ${bytes.length} bytes`);
    s.session.dispose();
  } finally {
    server.close();
  }
});

test('tiers come one after the other, then detail; the first with a part of the bytes', async () => {
  const tiers = read(streamOf('tiers'));
  const server = await serve(tiers);
  try {
    const s = sessionOf(new HttpSource(server.url));
    const info = await s.session.open();
    assert.equal(info.lastTier, 2);
    /** @type {Record<string, number>} */
    const bytesOf = {};
    s.session.post = message => {
      s.posts.push(message);
      if (message.type === 'ready') bytesOf[`${message.detail} ${message.tier}`] ??= s.session.fetcher.bytes;
    };
    s.session.want({time: info.timeBegin, ahead: 0, detail: 'auto'}, true);
    await until(() => s.of('ready').some(r => r.detail === 'full'), 'all of it');
    assert.deepEqual(Object.keys(bytesOf), ['base 0', 'base 1', 'base 2', 'full 2']);
    assert.ok(bytesOf['base 0'] < 0.7 * bytesOf['base 2'], JSON.stringify(bytesOf));
    // What has come as a tier in base colours is there again in detail.
    const counts = Object.values(rowsOf(s));
    s.session.want({time: info.timeBegin, ahead: 0, detail: 'auto', maxTier: 0}, true);
    await until(() => s.of('ready').at(-1).tier === 0, 'the first tier again');
    assert.equal(Object.values(rowsOf(s)).length, counts.length);
    assert.deepEqual(s.of('error'), []);
    s.session.dispose();
  } finally {
    server.close();
  }
});

test('a tier is the last that is fetched where more are not wanted', async () => {
  const server = await serve(read(streamOf('tiers')));
  try {
    const s = sessionOf(new HttpSource(server.url));
    const info = await s.session.open();
    s.session.want({time: info.timeBegin, ahead: 0, detail: 'auto', maxTier: 1}, true);
    await until(() => s.of('ready').some(r => r.detail === 'full'), 'the second tier in full');
    assert.deepEqual([...new Set(s.of('ready').map(r => `${r.detail} ${r.tier}`))], ['base 0', 'base 1', 'full 1']);
    const layers = new Set(s.of('rows').map(r => r.bucket.layer));
    s.session.want({time: info.timeBegin, ahead: 0, detail: 'auto'}, true);
    await until(() => s.of('ready').at(-1).tier === 2 && s.of('ready').at(-1).detail === 'full', 'all tiers');
    assert.ok(new Set(s.of('rows').map(r => r.bucket.layer)).size > layers.size);
    s.session.dispose();
  } finally {
    server.close();
  }
});

/**
 * A clock that goes on only while fn waits for it: what is computed takes no time, on however busy a machine.
 * @param {(clock: {now: () => number, wait: (ms: number) => Promise<void>, run: (ms: number) => Promise<void>}) => Promise<void>} fn
 * wait: until it has gone on so far; run: lets it go on so far, and each that waits do what it does then
 */
const withOwnClock = async fn => {
  let time = 1000;
  /** @type {{at: number, wake: () => void}[]} */
  const waiting = [];
  /** All that follows from what has happened is done, however many steps it takes: nothing of it waits for anything else. */
  const settle = async () => { for (let k = 0; k < 50; ++k) await new Promise(resolve => setImmediate(resolve)); };
  const mocked = mock.method(performance, 'now', () => time);
  try {
    await fn({
      now: () => time,
      wait: ms => new Promise(resolve => waiting.push({at: time + Math.max(ms, 0), wake: () => resolve(undefined)})),
      run: async ms => {
        const end = time + ms;
        for (;;) {
          await settle();
          const next = waiting.reduce((first, one) => one.at < first.at ? one : first, {at: end, wake: () => {}});
          time = next.at;
          const index = waiting.indexOf(next);
          if (index < 0) return;
          waiting.splice(index, 1);
          next.wake();
        }
      }
    });
  } finally {
    mocked.mock.restore();
  }
};

/**
 * fetch() of ranges of a file over one line of so many bytes a second, which all answers share.
 * @param {Uint8Array} file @param {number} rate @param {{now: () => number, wait: (ms: number) => Promise<void>}} clock
 */
const slowFetch = (file, rate, clock) => {
  let free = 0;
  return async (/** @type {string} */ _url, /** @type {any} */ {headers, signal}) => {
    const [, first, last] = /** @type {RegExpExecArray} */ (/^bytes=(\d+)-(\d+)$/.exec(headers.Range));
    const [begin, end] = [Number(first), Math.min(Number(last) + 1, file.length)];
    let at = begin;
    const body = new ReadableStream({
      start: control => signal.addEventListener('abort', () => control.error(signal.reason), {once: true}),
      pull: async control => {
        const piece = file.slice(at, Math.min(at + 4096, end));
        free = Math.max(free, clock.now()) + 1000 * piece.length / rate;
        await clock.wait(free - clock.now());
        if (signal.aborted) return;
        at += piece.length;
        control.enqueue(piece);
        if (at === end) control.close();
      }
    }, {highWaterMark: 1});
    return new Response(body, {status: 206, headers: {'Content-Range': `bytes ${begin}-${end - 1}/${file.length}`, ETag: '"1"'}});
  };
};

test('a link that is too slow for all plays what it can bring, without a stall', () => withOwnClock(async clock => {
  // Of 50,000 for a second of it all, which is not enough here.
  const fetching = /** @type {any} */ (slowFetch(read(streamOf('tiers')), 70_000, clock));
  const s = sessionOf(new HttpSource('http://slow.example/scene.l4d', {fetch: fetching, timeout: 300}));
  /** Lets the clock go on until this holds. @param {() => boolean} condition @param {string} what */
  const untilThen = async (condition, what) => {
    for (const end = Date.now() + 60000; !condition();) {
      assert.ok(Date.now() < end, `waited in vain for ${what}`);
      await clock.run(25);
    }
  };
  let info = /** @type {any} */ (null);
  void s.session.open().then(opened => { info = opened; });
  await untilThen(() => info !== null, 'the file to be opened');
  const goal = (/** @type {number} */ time) => ({time, ahead: 6, detail: /** @type {const} */ ('auto'), playing: true});
  s.session.want(goal(info.timeBegin), true);
  await untilThen(() => s.of('ready').length > 0, 'the first picture');
  let late = 0;
  for (let k = 0; k < 12; ++k) {
    const time = info.timeBegin + k / 4;
    s.session.want(goal(time), false);
    if (time > Math.max(...s.of('ready').map(r => r.until))) ++late;
    await clock.run(250);
  }
  assert.ok(late <= 1, `${late} of 12 instants were late`);
  // The instant in full would have come first without the controller.
  assert.equal(s.of('ready').find(r => r.until > info.timeBegin + 1)?.detail, 'base');
  assert.deepEqual(s.of('error'), []);
  s.session.dispose();
}));

test('a seek to the instant that is under way cancels nothing, and is answered', async () => {
  const server = await serve(bytes, {rate: 400_000});
  try {
    const s = sessionOf(new HttpSource(server.url));
    const info = await s.session.open();
    const goal = {time: info.timeBegin, ahead: 0, detail: /** @type {const} */ ('auto')};
    s.session.want(goal, true);
    await until(() => server.requests.length > 1, 'a request');
    const {signal} = s.session.control;
    s.session.want({...goal, id: 3}, true);
    assert.ok(!signal.aborted);
    await until(() => s.of('ready').some(r => r.id === 3 && r.detail === 'full'), 'the answer');
    s.session.want({...goal, id: 4}, true);
    await until(() => s.of('ready').some(r => r.id === 4), 'the answer to one that is here');
    const sent = server.requests.map(([offset]) => offset);
    assert.equal(new Set(sent).size, sent.length, `${sent}`);
    s.session.dispose();
  } finally {
    server.close();
  }
});

test('the directory that is fetched for later seeks is no error where it does not come', async () => {
  // Page tables of the middle are beyond the head of the file: pages of them are asked for in the end.
  const server = await serve(bytes);
  const s = sessionOf(new HttpSource(server.url));
  const info = await s.session.open();
  s.session.decoder.windowReads = new Proxy(s.session.decoder.windowReads, {
    apply: (target, self, args) => args[0] === info.timeBegin && args[1] === s.session.end ? [[bytes.length - 4096, 4096]] :
      target.apply(self, args)
  });
  const {read} = s.session.fetcher.source;
  s.session.fetcher.source.read = (offset, ...rest) =>
    offset >= bytes.length - 8192 ? Promise.reject(new L4DError('HTTP', 'gone')) : read.call(s.session.fetcher.source, offset, ...rest);
  s.session.want({time: info.timeBegin, ahead: 0, detail: 'auto'}, true);
  await until(() => !s.session.pumping && s.of('ready').some(r => r.detail === 'full'), 'the picture');
  assert.deepEqual(s.of('error'), []);
  assert.equal(s.session.hasIndex, false);
  s.session.dispose();
  server.close();
});

test('a server without ranges is read from the front', async () => {
  const server = await serve(bytes, {ranges: false});
  try {
    const s = await show(new HttpSource(server.url));
    assert.deepEqual(s.of('error'), []);
    assert.equal(server.requests.length, 1);
    s.session.dispose();
  } finally {
    server.close();
  }
});

test('cut answers and errors of a server are tried again', async () => {
  const server = await serve(bytes, {fail: n => n === 2 ? 'cut' : n === 3 ? 503 : undefined});
  try {
    const retries = [];
    const s = await show(new HttpSource(server.url, {onRetry: why => retries.push(why)}));
    assert.deepEqual(s.of('error'), []);
    assert.ok(retries.length >= 2);
    s.session.dispose();
  } finally {
    server.close();
  }
});

test('a file that changes is told, and so are 404, 416 and a server that is not there', async () => {
  let etag = '"1"';
  const server = await serve(bytes, {etag: () => etag});
  const s = sessionOf(new HttpSource(server.url));
  const info = await s.session.open();
  etag = '"2"';
  s.session.want({time: info.timeBegin, ahead: 0, detail: 'auto'}, true);
  await until(() => s.of('error').length > 0, 'the error');
  assert.equal(s.of('error')[0].error.code, 'CHANGED');
  server.close();
  const lost = sessionOf(new HttpSource(server.url));
  await assert.rejects(lost.session.open(), {code: 'NETWORK'});
  const empty = await serve(new Uint8Array(0));
  await assert.rejects(sessionOf(new HttpSource(empty.url)).session.open(), {code: 'TRUNCATED'});
  empty.close();
  const missing = await serve(bytes, {fail: () => 404});
  await assert.rejects(sessionOf(new HttpSource(missing.url)).session.open(), {code: 'NOT_FOUND'});
  missing.close();
});

for (const [what, status, headers, type, code, words] of /** @type {[string, number, any, string, string, RegExp][]} */ ([
  ['no file', 404, {}, 'basic', 'NOT_FOUND', /status 404; check the address/],
  ['a file that is gone', 410, {}, 'cors', 'NOT_FOUND', /status 410/],
  ['a server that wants to know who asks', 403, {}, 'basic', 'HTTP', /status 403.*credentials/],
  ['another part', 206, {'Content-Range': 'bytes 8-65535/99999'}, 'cors', 'NO_RANGES', /bytes 8-65535\/99999, where byte 0 is wanted/]
])) {
  test(`refused, and told what helps: ${what}`, async () => {
    const answer = async () => Object.defineProperty(new Response('', {status, headers}), 'type', {value: type});
    const {session} = sessionOf(new HttpSource('http://other.org/a.l4d', {fetch: answer}));
    await assert.rejects(session.open(), error => error instanceof L4DError && error.code === code && words.test(error.message));
  });
}

test('an answer that does not come names the other origin as what may forbid it', () => {
  const {location} = /** @type {any} */ (globalThis);
  try {
    Object.assign(globalThis, {location: {origin: 'http://here.org'}});
    assert.match(fetchError('http://other.org/a.l4d', new TypeError('Failed to fetch')).message, /Failed to fetch; .*Access-Control-Allow-Origin/);
    assert.equal(fetchError('http://here.org/a.l4d', new TypeError('Failed to fetch')).message, 'http://here.org/a.l4d: Failed to fetch');
  } finally {
    Object.assign(globalThis, {location});
  }
});

test('a file that is cut short: each part that is lost is told once; who is not tolerant is refused', async () => {
  const cut = read(streamOf('tiers')).slice(0, 300_000);
  const folder = mkdtempSync(join(tmpdir(), 'l4dweb-'));
  writeFileSync(join(folder, 'cut.l4d'), cut);
  const {errors} = JSON.parse(spawnSync(tool, ['validate', join(folder, 'cut.l4d'), '--json']).stdout.toString());
  rmSync(folder, {recursive: true});
  const s = sessionOf(new BufferSource(cut.slice().buffer));
  const {timeBegin, duration} = await s.session.open();
  for (const id of [1, 2, 3]) {
    s.session.want({time: timeBegin + (id === 2 ? 1 : 0), ahead: duration, detail: 'auto', id}, true);
    await until(() => !s.session.pumping && s.of('ready').some(r => r.id === id), 'all of it');
  }
  // Each part that the tool names, and each once.
  const losses = s.of('loss').flatMap(p => p.losses);
  assert.ok(errors.length > 2);
  assert.deepEqual(losses.map(l => [l.clause, l.offset]).sort(), errors.map((/** @type {any} */ e) => [e.clause, e.offset]).sort());
  assert.ok(losses.every(l => l.code === 'TRUNCATED' && l.gaussians > 0));
  assert.equal(s.session.statistics().lost, losses.length);
  assert.deepEqual(s.of('error'), []);
  const strict = sessionOf(new BufferSource(cut.slice().buffer), {tolerant: false});
  await strict.session.open();
  strict.session.want({time: timeBegin, ahead: 0, detail: 'auto', id: 1}, true);
  await until(() => strict.of('error').length > 0, 'the error');
  const [{error}] = strict.of('error');
  assert.deepEqual([error.code, error.clause], ['TRUNCATED', 'CHNK-1']);
  assert.ok(error.offset > 0 && error.offset < cut.length, `${error.offset}`);
  for (const one of [s, strict]) one.session.dispose();
});

test('seeks cancel what is under way; the last one is answered', async () => {
  const server = await serve(bytes);
  try {
    const s = sessionOf(new HttpSource(server.url));
    const info = await s.session.open();
    for (let k = 0; k < 50; ++k) {
      s.session.want({time: info.timeBegin + info.duration * (k % 10) / 10, ahead: 2, detail: 'auto', id: k}, true);
      if (k % 7 === 0) await new Promise(resolve => setTimeout(resolve, 5));
    }
    await until(() => s.of('ready').some(r => r.id === 49), 'the last seek');
    assert.deepEqual(s.of('error'), []);
    s.session.dispose();
  } finally {
    server.close();
  }
});

test('memory stays flat over 500 seeks, and rows within their limit', async () => {
  const maxRows = 5000;
  const s = sessionOf(new BufferSource(bytes.slice().buffer), {maxRows});
  const info = await s.session.open();
  const held = new Map();
  let after = 0;
  for (let k = 0; k < 500; ++k) {
    s.session.want({time: info.timeBegin + info.duration * ((k * 37) % 100) / 100, ahead: 0.2, detail: 'auto', id: k}, true);
    await until(() => s.of('ready').some(r => r.id === k && r.detail === 'full'), `seek ${k}`);
    for (const p of s.posts.splice(0)) {
      if (p.type === 'rows') held.set(p.key, p.count);
      if (p.type === 'removed') held.delete(p.key);
    }
    if (k === 50) after = s.session.statistics().memoryBytes;
  }
  assert.equal(s.session.statistics().memoryBytes, after);
  assert.equal(s.session.statistics().rows, [...held.values()].reduce((a, b) => a + b, 0));
  s.session.dispose();
});

test('slice() brings the bytes that it needs, and can be aborted', async () => {
  const server = await serve(bytes);
  try {
    const s = sessionOf(new HttpSource(server.url));
    const info = await s.session.open();
    const control = new AbortController();
    const slice = await s.session.slice(info.timeBegin + 1, {}, control.signal);
    assert.ok(slice.count > 0);
    control.abort();
    await assert.rejects(s.session.slice(info.timeBegin + 3, {}, control.signal), {name: 'AbortError'});
    s.session.dispose();
  } finally {
    server.close();
  }
});
