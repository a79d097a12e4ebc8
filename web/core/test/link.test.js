// SPDX-License-Identifier: Apache-2.0
// Sources over HTTP: what they send, which servers they get on with, how long they wait, where they try again.
import assert from 'node:assert/strict';
import {createServer} from 'node:http';
import {test} from 'node:test';
import {gzipSync} from 'node:zlib';
import {openInNode} from '../../test/node-movie.js';
import {HttpSource} from '../src/sources.js';
import {holdingTimers, read, streamOf} from './fixture.js';
import {serve} from './server.js';

const bytes = read(streamOf('tiers'));
const wasmPath = /** @type {string} */ (process.env.L4D_WASM);
const {signal} = new AbortController();

/** All of a file, as a source brings it: its beginning, and two ranges. @param {HttpSource} source */
const allOf = async source => {
  const got = new Uint8Array(await source.open(signal));
  const keep = (/** @type {number} */ offset, /** @type {Uint8Array} */ piece) => got.set(piece, offset);
  source.begin(keep);
  const middle = Math.floor(got.length / 8192) * 4096;
  for (const [offset, size] of [[middle, got.length - middle], [0, middle]]) await source.read(offset, size, signal, keep);
  return got;
};

/** @param {any} options of the server @param {(server: any) => Promise<void>} fn */
const withServer = async (options, fn) => {
  const server = await serve(bytes, options);
  try {
    await fn(server);
  } finally {
    server.close();
  }
};

/** fetch() of a page of another origin, which sees what is exposed. @param {string[]} exposed */
const crossOrigin = (...exposed) => async (/** @type {any} */ url, /** @type {any} */ init) => {
  assert.deepEqual(Object.keys(init.headers).filter(name => name !== 'Range'), [], 'what needs a preflight');
  const {status, body, headers} = await fetch(url, init);
  const seen = [...headers].filter(([name]) => ['content-length', 'last-modified', ...exposed].includes(name));
  return Object.defineProperty(new Response(body, {status, headers: seen}), 'type', {value: 'cors'});
};

for (const [what, exposed] of /** @type {[string, string[]][]} */ ([
  ['all', ['content-range', 'etag', 'content-encoding']], ['no tag', ['content-range']], ['nothing', []]
])) {
  test(`another origin that exposes ${what}: no request has a header but Range`, () => withServer({}, async server => {
    assert.deepEqual(await allOf(new HttpSource(server.url, {fetch: crossOrigin(...exposed)})), bytes);
    assert.ok(server.seen.length <= (exposed.length > 0 ? 3 : 4) && server.requests.every(([, size]) => size > 0), `${server.requests}`);
    assert.ok(server.seen.every(({headers}) => !headers['if-range']));
  }));
}

test('what is compressed on its way has the size that it has in the end, also where that is hidden', async () => {
  const packed = gzipSync(bytes);
  const server = createServer((_request, response) => response.writeHead(200, {
    'Content-Encoding': 'gzip', 'Content-Length': packed.length}).end(packed));
  await new Promise(resolve => server.listen(0, '127.0.0.1', () => resolve(undefined)));
  try {
    const url = `http://127.0.0.1:${/** @type {any} */ (server.address()).port}/scene.l4d`;
    for (const fetching of [fetch, crossOrigin()]) assert.deepEqual(await allOf(new HttpSource(url, {fetch: fetching})), bytes);
  } finally {
    server.closeAllConnections();
    server.close();
  }
});

test('a part without a word of how much there is: all of the file is read', () => withServer(
  {headers: () => ({'Content-Range': 'bytes 0-65535/*'})}, async server => {
    assert.deepEqual(await allOf(new HttpSource(server.url)), bytes);
    assert.equal(server.seen.length, 2);
  }));

/** fetch() that counts what has come of the answer that came last. */
const countingFetch = () => {
  let came = 0;
  return {
    came: () => came,
    fetch: async (/** @type {any} */ url, /** @type {any} */ init) => {
      came = 0;
      const {status, headers, body} = await fetch(url, init);
      const counter = new TransformStream({transform: (piece, control) => { came += piece.length; control.enqueue(piece); }});
      return new Response(/** @type {any} */ (body).pipeThrough(counter), {status, headers});
    }
  };
};

for (const [what, fault] of /** @type {[string, any][]} */ ([
  ['status 503', 503], ['status 429', 429], ['a cut answer', 'cut'], ['silence', 'silent'], ['silence in the middle', 'stuck']
])) {
  test(`${what} costs one request more, at the first one and later`, () => withServer(
    {fail: (/** @type {number} */ n) => n % 2 ? fault : undefined}, server => holdingTimers([150], async timers => {
      // The time is over when all that the server says has been read: not sooner, as on a busy machine, where good answers are late.
      const counting = countingFetch();
      let silentAt = -1;
      const lapse = () => {
        if (counting.came() !== silentAt) return;
        silentAt = -1;
        timers.lapse();
      };
      server.onsilence = (/** @type {number} */ sent) => {
        silentAt = sent;
        setImmediate(lapse);
      };
      timers.onstart = () => setImmediate(lapse);
      const retries = /** @type {string[]} */ ([]);
      const source = new HttpSource(server.url, {timeout: 0.15, fetch: counting.fetch, onRetry: why => retries.push(why)});
      assert.deepEqual(await allOf(source), bytes);
      assert.equal(server.seen.length, 6);
      assert.equal(retries.length, 3);
      const isSilent = typeof fault === 'string' && fault !== 'cut';
      assert.deepEqual(timers.lapsed, isSilent ? [150, 150, 150] : []);
      for (const why of isSilent ? retries : []) assert.match(why, /nothing came for 0.15 s/);
    })));
}

test('a server that never says anything fails in the time that the page gives it', async () => {
  const why = {code: 'NETWORK', message: /nothing came for 0.1 s/};
  await withServer({fail: () => 'silent'}, server => holdingTimers([100, 200], async timers => {
    server.onsilence = timers.lapse;
    // Before it is sent again there is a pause.
    timers.onstart = () => setImmediate(() => { if (timers.lapsed.length === 1) timers.lapse(); });
    await assert.rejects(new HttpSource(server.url, {timeout: 0.1, retries: 1}).open(signal), why);
    assert.deepEqual(timers.lapsed, [100, 200, 100]);
    assert.equal(server.seen.length, 2);
    await assert.rejects(new HttpSource(server.url, {timeout: 0.1, retries: 0}).open(signal), why);
    assert.deepEqual(timers.lapsed, [100, 200, 100, 100]);
    assert.equal(server.seen.length, 3);
  }));
  // So it does by a clock, in less than the time that it has where the page gives it none.
  await withServer({fail: () => 'silent'}, async server => {
    const began = performance.now();
    await assert.rejects(new HttpSource(server.url, {timeout: 0.1, retries: 1}).open(signal), why);
    assert.ok(performance.now() - began < 10000);
  });
});

test('another version is told by either of ETag and Last-Modified, not by a weak tag; a cache that is behind is passed by', async () => {
  /** @param {(n: number) => Record<string, string>} headers @param {string} [tag] */
  const read = (headers, tag = '') => withServer({etag: () => tag, headers}, async server => void await allOf(new HttpSource(server.url)));
  const from = (/** @type {number} */ k, /** @type {string} */ name, /** @type {string} */ a, /** @type {string} */ b) =>
    (/** @type {number} */ n) => ({[name]: n < k ? a : b});
  await assert.rejects(read(from(2, 'Last-Modified', 'Tue, 01 Sep 2026 10:00:00 GMT', 'Wed, 02 Sep 2026 10:00:00 GMT')), {code: 'CHANGED'});
  await assert.rejects(read(from(2, 'ETag', '"1"', '"2"')), {code: 'CHANGED'});
  await read(from(2, 'ETag', '"1"', 'W/"1"'));
  await read(() => ({}));
  await read(n => ({ETag: n === 2 ? '"0"' : '"1"'}));
  await assert.rejects(read(n => n > 1 ? {'Content-Range': `bytes ${0}-9/12`} : {}), {code: 'NO_RANGES'});
});

test('the first request asks for what is new, later ones take what a cache has; or none does', () => withServer({}, async server => {
  const modes = /** @type {any[]} */ ([]);
  const fetching = (/** @type {any} */ url, /** @type {any} */ init) => { modes.push(init.cache); return fetch(url, init); };
  await allOf(new HttpSource(server.url, {fetch: fetching}));
  await allOf(new HttpSource(server.url, {fetch: fetching, cache: 'no-store'}));
  assert.deepEqual(modes, ['no-cache', 'default', 'default', 'no-store', 'no-store', 'no-store']);
}));

test('several servers: what fails at one comes from the next, which has tags of its own', () => withServer({etag: () => '"a"'}, first =>
  withServer({etag: () => '"b"'}, async second => {
    const folders = [first, second].map(({url}) => url.replace('scene.l4d', ''));
    for (const [bases, fault] of /** @type {[string[], any][]} */ ([
      [['http://127.0.0.1:9/', folders[0]], undefined], [folders, 404], [folders, 'cut'], [folders, 503]
    ])) {
      const source = new HttpSource(`${bases[0]}scene.l4d`, {bases, retries: 1});
      const got = new Uint8Array(await source.open(signal));
      const keep = (/** @type {number} */ offset, /** @type {Uint8Array} */ piece) => got.set(piece, offset);
      source.begin(keep);
      first.fault = fault;
      await source.read(0, got.length, signal, keep);
      first.fault = undefined;
      assert.deepEqual(got, bytes);
    }
    assert.equal(second.seen.length, 3);
    await assert.rejects(new HttpSource('http://127.0.0.1:9/a', {bases: ['http://127.0.0.1:9/', 'http://127.0.0.1:9/b/'], retries: 0}).open(signal),
                         {code: 'NETWORK'});
  })));

test('a page may change each request, and those that are sent again', () => withServer({}, async server => {
  let fails = true;
  server.answer = (/** @type {any} */ request) => {
    const isSigned = new URL(request.url, 'http://x').searchParams.get('token') === request.headers['x-token'];
    const status = !isSigned ? 403 : fails && request.headers['x-token'] === '2' ? 503 : undefined;
    if (status === 503) fails = false;
    return status;
  };
  let count = 0;
  const movie = await openInNode(server.url, wasmPath, {
    headers: {'x-of-page': 'yes'},
    request: async (/** @type {any} */ {url, headers}) => {
      ++count;
      return {url: `${url}?token=${count}`, headers: {...headers, 'x-token': String(count)}};
    }
  });
  await movie.seek(movie.timeEnd / 2);
  movie.dispose();
  assert.ok(count >= server.seen.length && server.seen.length >= 3, `${count}, ${server.seen.length}`);
  assert.ok(server.seen.every((/** @type {any} */ {headers}) => headers['x-of-page'] === 'yes' && headers.range));
  await assert.rejects(openInNode(server.url, wasmPath, {request: () => { throw new Error('no token today'); }}),
                       {code: 'REQUEST', message: /scene.l4d: no token today/});
  const plain = await openInNode(server.url, wasmPath, {request: () => {}}).catch(error => error);
  assert.equal(plain.code, 'HTTP');
}));
