// SPDX-License-Identifier: Apache-2.0
// The engine through WebAssembly over HTTP and over memory, each feature once: tests/playback has the rest.
import assert from 'node:assert/strict';
import {spawnSync} from 'node:child_process';
import {mkdtempSync, rmSync, writeFileSync} from 'node:fs';
import {tmpdir} from 'node:os';
import {join} from 'node:path';
import {test} from 'node:test';
import {Link, LocalLink} from '../src/link.js';
import {engineOf, read, streamOf, streams, tool, until} from './fixture.js';
import {serve} from './server.js';

const bytes = read(streams[0]);
const {signal} = new AbortController();
const memory = (data = bytes) => new LocalLink(data.slice().buffer);

/** @param {string} url @param {any} [options] of the link, and of the engine */
const over = (url, options = {}) => engineOf(new Link(url, options), options, url);

/** Opens, seeks and waits for the picture, all of it. @param {any} e what engineOf() makes @param {number} [share] of the duration */
const show = async (e, share = 0.5, id = 7) => {
  const one = await e;
  const {engine, state} = one;
  const info = engine.info ?? await engine.open();
  engine.seek(info.timeBegin + share * info.duration, id);
  await until(() => state().id === id && state().detail === 'full' || one.of('error').length > 0, `the picture of ${share}`);
  return one;
};

/** Keys and rows of all full buckets. */
const rowsOf = (/** @type {any} */ e) => Object.fromEntries(e.of('rows').filter((/** @type {any} */ r) => r.detail === 0)
  .map((/** @type {any} */ r) => [r.key, r.count]).sort());

test('memory, a Blob and HTTP give the same rows; base colours come first', async () => {
  const server = await serve(bytes, {rate: 1e6});
  try {
    const first = await show(engineOf(memory()));
    const blob = await show(engineOf(new LocalLink(new Blob([bytes]))));
    const http = await show(over(server.url));
    assert.ok(Object.keys(rowsOf(first)).length > 1);
    for (const e of [blob, http]) {
      const common = Object.keys(rowsOf(e)).filter(key => key in rowsOf(first));
      assert.ok(common.length > 1);
      for (const key of common) assert.equal(rowsOf(e)[key], rowsOf(first)[key], key);
    }
    assert.deepEqual(http.of('error'), []);
    assert.equal(http.of('state').find(s => s.id === 7)?.detail, 'base');
    // As few requests as that, and no byte twice: of one that was cancelled, what had come stays.
    const {bytes: received} = http.engine.statistics();
    assert.ok(server.requests.length <= 16, `${server.requests.length} requests`);
    assert.ok(received <= 1.1 * bytes.length, `${received} of ${bytes.length} bytes`);
    for (const {engine} of [first, blob, http]) engine.dispose();
  } finally {
    server.close();
  }
});

test('it plays to the end, waits for nothing that is here, and tells the page only what changes', async () => {
  const e = await show(engineOf(memory()), 0.99);
  const {engine, state} = e;
  engine.command('play');
  await until(() => state().hasEnded, 'the end');
  assert.ok(Math.abs(state().time - engine.info.timeBegin - engine.info.duration) < 1e-9);
  assert.equal(e.of('state').filter(s => s.isPlaying).length > 0, true);
  assert.ok(e.of('state').length < 40, `${e.of('state').length} states`);
  engine.dispose();
});

test('tiers: one contains the other, and a tier is the last that is fetched where more are not wanted', async () => {
  const server = await serve(read(streamOf('tiers')));
  try {
    const e = await over(server.url);
    const info = await e.engine.open();
    assert.deepEqual([info.lastTier, info.tiers], [2, [0, 1, 2]]);
    e.engine.setQuality({maxTier: 1});
    e.engine.seek(info.timeBegin, 1);
    await until(() => e.state().id === 1 && e.state().tier === 1, 'the second tier');
    const layers = new Set(e.of('rows').map(r => r.bucket.layer));
    assert.ok(e.of('state').every(s => s.tier <= 1 && s.detail !== 'full'));
    e.engine.setQuality({});
    await until(() => e.state().detail === 'full', 'all of it');
    assert.ok(new Set(e.of('rows').map(r => r.bucket.layer)).size > layers.size);
    e.engine.dispose();
  } finally {
    server.close();
  }
});

test('a server without ranges is read from the front, once', async () => {
  const server = await serve(bytes, {ranges: false});
  try {
    const e = await show(over(server.url));
    assert.deepEqual(e.of('error'), []);
    assert.equal(server.requests.length, 1);
    assert.equal(e.engine.info.fileBytes, bytes.length);
    e.engine.dispose();
  } finally {
    server.close();
  }
});

test('cut answers and errors of a server are tried again', async () => {
  const server = await serve(bytes, {fail: n => n === 1 || n === 3 ? 503 : n === 2 ? 'cut' : undefined});
  try {
    const e = await show(over(server.url));
    assert.deepEqual(e.of('error'), []);
    assert.ok(e.of('retry').length >= 2);
    e.engine.dispose();
  } finally {
    server.close();
  }
});

test('a file that changes is told, and so are 403, 404, 416 and a server that is not there', async () => {
  let etag = '"1"';
  const server = await serve(bytes, {etag: () => etag});
  const e = await over(server.url);
  const info = await e.engine.open();
  etag = '"2"';
  e.engine.seek(info.timeBegin + info.duration * 0.9, 1);
  await until(() => e.of('error').length > 0, 'the error');
  assert.deepEqual([e.of('error')[0].error.code, e.of('error')[0].turn], ['CHANGED', 0]);
  // Also for who seeks later: what is known of it is not of the other file.
  e.engine.seek(info.timeBegin, 2);
  assert.deepEqual(e.of('error').map(one => [one.error.code, one.id]), [['CHANGED', undefined], ['CHANGED', 2]]);
  e.engine.dispose();
  server.close();
  const refused = async (/** @type {string} */ url, /** @type {any} */ wanted) => {
    const {engine} = await over(url, {failures: 2});
    await assert.rejects(engine.open(), wanted);
    engine.dispose();
  };
  await refused(server.url, {code: 'NETWORK'});
  for (const [status, code, message] of /** @type {[number, string, RegExp][]} */ ([
    [404, 'NOT_FOUND', /status 404; check the address/], [410, 'NOT_FOUND', /status 410/], [403, 'HTTP', /status 403.*credentials/],
    [503, 'NETWORK', /status 503/]
  ])) {
    const failing = await serve(bytes, {fail: () => status});
    await refused(failing.url, {code, message});
    failing.close();
  }
  const empty = await serve(new Uint8Array(0));
  await refused(empty.url, {code: 'TRUNCATED'});
  empty.close();
  const other = await serve(bytes, {headers: () => ({'Content-Range': 'bytes 8-65535/99999'})});
  await refused(other.url, {code: 'NO_RANGES', message: /bytes 8-65535\/99999, where byte 0 is wanted/});
  other.close();
});

test('what is no stream, and what is damaged, is refused with a reason', async () => {
  const refused = async (/** @type {Uint8Array} */ data, /** @type {RegExp} */ code) => {
    const {engine} = await engineOf(memory(data));
    await assert.rejects(engine.open(), error => code.test(/** @type {any} */ (error).code));
    engine.dispose();
  };
  await refused(new Uint8Array(64), /^NOT_L4D$/);
  const damaged = bytes.slice();
  damaged[60] ^= 0x55;
  await refused(damaged, /^(CORRUPT|CHECKSUM)$/);
});

test('a file that is cut short: each part that is lost is told once; who is not tolerant is refused', async () => {
  const cut = read(streamOf('tiers')).slice(0, 300_000);
  const folder = mkdtempSync(join(tmpdir(), 'l4dweb-'));
  writeFileSync(join(folder, 'cut.l4d'), cut);
  const {errors} = JSON.parse(spawnSync(tool, ['validate', join(folder, 'cut.l4d'), '--json']).stdout.toString());
  rmSync(folder, {recursive: true});
  const e = await engineOf(memory(cut));
  const losses = () => e.of('loss').flatMap(p => p.losses);
  for (const share of [0, 0.3, 0.6, 1, 0]) await show(e, share, 8 + 10 * share);
  await until(() => losses().length >= errors.length, 'all losses');
  assert.ok(errors.length > 2);
  assert.deepEqual(losses().map(l => [l.clause, l.offset]).sort(), errors.map((/** @type {any} */ one) => [one.clause, one.offset]).sort());
  assert.ok(losses().every(l => l.code === 'TRUNCATED' && l.gaussians > 0));
  assert.equal(e.engine.statistics().lost, losses().length);
  assert.deepEqual(e.of('error'), []);
  const strict = await engineOf(memory(cut), {tolerant: false});
  const {timeBegin} = await strict.engine.open();
  strict.engine.seek(timeBegin, 1);
  await until(() => strict.of('error').length > 0, 'the error');
  const [{error}] = strict.of('error');
  assert.equal(error.code, 'TRUNCATED');
  assert.ok(error.offset > 0, `${error.offset}`);
  for (const {engine} of [e, strict]) engine.dispose();
});

test('seeks, and scrubbing: the last one is answered', async () => {
  const server = await serve(bytes);
  try {
    const e = await over(server.url);
    const info = await e.engine.open();
    for (let k = 0; k < 50; ++k) {
      e.engine.seek(info.timeBegin + info.duration * (k % 10) / 10, k, k % 3 ? 0.05 : 0);
      if (k % 7 === 0) await new Promise(resolve => setTimeout(resolve, 5));
    }
    await until(() => e.of('shown').some(s => s.id === 49), 'the last seek');
    assert.deepEqual(e.of('error'), []);
    e.engine.dispose();
  } finally {
    server.close();
  }
});

test('memory stays flat over 500 seeks, and rows within their limit', async () => {
  const maxRows = 20480;
  const e = await engineOf(memory(), {maxRows, ahead: 0.5});
  const {engine, posts} = e;
  const info = await engine.open();
  const held = new Map();
  let after = 0;
  for (let k = 1; k <= 500; ++k) {
    // A new view: what was sent before has come to the views, too.
    if (k % 50 === 0) engine.command('refresh');
    engine.seek(info.timeBegin + info.duration * ((k * 37) % 100) / 100, k);
    await until(() => posts.some(p => p.type === 'shown' && p.id === k), `seek ${k}`);
    for (const p of posts.splice(0)) {
      if (p.type === 'rows') held.set(p.key, p.count);
      if (p.type === 'removed') held.delete(p.key);
      const rows = [...held.values()].reduce((sum, n) => sum + 256 * Math.ceil(n / 256), 0);
      assert.ok(rows <= maxRows, `${rows} rows`);
    }
    if (k === 100) after = engine.statistics().memoryBytes;
  }
  assert.equal(engine.statistics().memoryBytes, after);
  assert.equal(engine.statistics().rows, [...held.values()].reduce((a, b) => a + b, 0));
  engine.dispose();
});

test('all rows come again when a view is new', async () => {
  const e = await show(engineOf(memory()));
  const before = rowsOf(e);
  e.posts.length = 0;
  e.engine.command('refresh');
  await until(() => e.state().detail === 'full', 'all rows');
  assert.ok(Object.keys(rowsOf(e)).length > 1);
  for (const key of Object.keys(rowsOf(e))) assert.equal(rowsOf(e)[key], before[key]);
  e.engine.dispose();
});

test('slice() brings the bytes that it needs, one after the other, and can be aborted', async () => {
  const server = await serve(read(streamOf('tiers')));
  try {
    const {engine} = await over(server.url, {slices: true, ahead: 0.5});
    const {timeBegin} = await engine.open();
    const control = new AbortController();
    const slices = [0, 1, 2].map(maxTier => engine.slice(timeBegin + 1, {maxTier}, signal));
    const aborted = engine.slice(timeBegin + 7, {}, control.signal);
    control.abort();
    await assert.rejects(aborted, {name: 'AbortError'});
    const [a, b, c] = await Promise.all(slices);
    assert.ok(0 < a.count && a.count < b.count && b.count < c.count);
    assert.equal((await engine.slice(timeBegin + 3, {sh: false}, signal)).sh, null);
    engine.dispose();
  } finally {
    server.close();
  }
});
