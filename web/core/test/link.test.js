// SPDX-License-Identifier: Apache-2.0
// How requests are sent: headers, caches, versions, other servers, and what servers make of ranges.
import assert from 'node:assert/strict';
import {createServer} from 'node:http';
import {test} from 'node:test';
import {gzipSync} from 'node:zlib';
import {openInNode} from '../../test/node-movie.js';
import {fetchError, L4DError} from '../src/errors.js';
import {Link, LocalLink} from '../src/link.js';
import {engineOf, read, streamOf, until} from './fixture.js';
import {serve} from './server.js';

const bytes = read(streamOf('tiers'));
const wasmPath = /** @type {string} */ (process.env.L4D_WASM);
const {signal} = new AbortController();

/** Sends one request. @param {any} link @param {string} url @param {any} [ask] */
const ask = async (link, url, ask = {}) => {
  const seen = {head: /** @type {any} */ (null), bytes: new Uint8Array(0)};
  await link.send(url, {offset: 0, size: 0, ...ask}, signal, {
    answered: (/** @type {any} */ head) => { seen.head = head; },
    received: (/** @type {Uint8Array} */ piece) => { seen.bytes = new Uint8Array([...seen.bytes, ...piece]); }
  });
  return seen;
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

/**
 * Opens over a link and waits for a picture: what lies in the file.
 * @param {string} url @param {any} options @param {(info: any) => boolean} [isKnown] what else is waited for
 */
const play = async (url, options, isKnown = () => true) => {
  const e = await engineOf(new Link(url, options), options, url);
  const info = await e.engine.open();
  e.engine.seek(info.timeBegin + 0.9 * info.duration, 1);
  await until(() => e.state().id === 1 && e.state().detail === 'full' && isKnown(e.engine.info), 'the picture');
  assert.deepEqual(e.of('error'), []);
  e.engine.dispose();
  return e.engine.info;
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
    await play(server.url, {fetch: crossOrigin(...exposed)});
    assert.ok(server.requests.every(([, size]) => size > 0), `${server.requests}`);
    assert.ok(server.seen.every(({headers}) => headers.range && !headers['if-range']));
  }));
}

test('a range, the rest of a file, and all of it', () => withServer({}, async server => {
  for (const link of [new Link(server.url), new LocalLink(bytes.slice().buffer), new LocalLink(new Blob([bytes]))]) {
    const part = await ask(link, server.url, {offset: 100, size: 50});
    assert.deepEqual([part.head.status, part.head.offset, part.head.total], [206, 100, bytes.length]);
    assert.deepEqual(part.bytes, bytes.slice(100, 150));
    const rest = await ask(link, server.url, {offset: bytes.length - 9});
    assert.deepEqual([rest.head.offset, rest.bytes], [bytes.length - 9, bytes.slice(-9)]);
    assert.equal((await ask(link, server.url, {offset: bytes.length})).head.status, 416);
  }
  assert.deepEqual(server.seen.map(r => r.headers.range).slice(0, 2), ['bytes=100-149', `bytes=${bytes.length - 9}-`]);
  const whole = await ask(new Link(server.url), server.url, {isWhole: true});
  assert.deepEqual([whole.head.status, whole.head.total, whole.bytes.length], [200, bytes.length, bytes.length]);
  assert.equal(server.seen.at(-1).headers.range, undefined);
}));

test('what is compressed on its way has the size that it has in the end, also where that is hidden', async () => {
  const packed = gzipSync(bytes);
  const server = createServer((_request, response) => response.writeHead(200, {
    'Content-Encoding': 'gzip', 'Content-Length': packed.length}).end(packed));
  await new Promise(resolve => server.listen(0, '127.0.0.1', () => resolve(undefined)));
  try {
    const url = `http://127.0.0.1:${/** @type {any} */ (server.address()).port}/scene.l4d`;
    for (const fetching of [fetch, crossOrigin()]) {
      // Where the size is hidden, it is known with the last byte, which the picture does not wait for.
      const info = await play(url, {fetch: fetching}, ({fileBytes}) => fileBytes > 0);
      assert.equal(info.fileBytes, bytes.length);
    }
  } finally {
    server.closeAllConnections();
    server.close();
  }
});

test('a browser that takes no part of a file that is compressed on its way gets all of it', () => withServer({ranges: false}, async server => {
  const fetching = (/** @type {any} */ url, /** @type {any} */ init) => init.headers.Range ? Promise.reject(new TypeError('Failed to fetch')) : fetch(url, init);
  await play(server.url, {fetch: fetching});
  assert.equal(server.seen.length, 1);
}));

test('a part without a word of how much there is', () => withServer(
  {headers: () => ({'Content-Range': 'bytes 0-65535/*'})}, async server => {
    const {head} = await ask(new Link(server.url), server.url, {size: 65536});
    assert.deepEqual([head.offset, head.total], [0, 0]);
  }));

for (const [what, fault] of /** @type {[string, any][]} */ ([
  ['status 503', 503], ['status 429', 429], ['a cut answer', 'cut'], ['silence', 'silent'], ['silence in the middle', 'stuck']
])) {
  test(`${what}: tried again, at the first request and later`, () => withServer(
    {fail: (/** @type {number} */ n) => n % 2 ? fault : undefined}, async server => {
      await play(server.url, {timeout: 0.15});
      assert.ok(server.seen.length >= 4, `${server.seen.length}`);
    }));
}

test('a server that never says anything fails in the time that the page gives it', () => withServer({fail: () => 'silent'}, async server => {
  const {engine, of} = await engineOf(new Link(server.url), {timeout: 0.5, failures: 2}, server.url);
  await assert.rejects(engine.open(), {code: 'NETWORK', message: /does not answer/});
  assert.equal(server.seen.length, 2);
  assert.equal(of('retry').length, 2);
  engine.dispose();
}));

test('a version is told by either of ETag and Last-Modified, not by a weak tag; a cache that is behind is passed by', async () => {
  /** Versions of three requests, and what caches were asked. @param {(n: number) => Record<string, string>} headers @param {string} [tag] */
  const read = async (headers, tag = '') => {
    const versions = /** @type {number[]} */ ([]), modes = /** @type {string[]} */ ([]);
    await withServer({etag: () => tag, headers}, async server => {
      const link = new Link(server.url, {fetch: (url, init) => { modes.push(init?.cache ?? ''); return fetch(url, init); }});
      for (let k = 0; k < 3; ++k) versions.push((await ask(link, server.url, {size: 10})).head.version);
    });
    return [versions.join(), modes.filter(mode => mode === 'reload').length];
  };
  const from = (/** @type {number} */ k, /** @type {string} */ name, /** @type {string} */ a, /** @type {string} */ b) =>
    (/** @type {number} */ n) => ({[name]: n < k ? a : b});
  assert.deepEqual(await read(from(2, 'Last-Modified', 'Tue, 01 Sep 2026 10:00:00 GMT', 'Wed, 02 Sep 2026 10:00:00 GMT')), ['1,2,2', 1]);
  assert.deepEqual(await read(from(2, 'ETag', '"1"', '"2"')), ['1,2,2', 1]);
  assert.deepEqual(await read(from(2, 'ETag', '"1"', 'W/"1"')), ['1,1,1', 0]);
  assert.deepEqual(await read(() => ({})), ['0,0,0', 0]);
  assert.deepEqual(await read(n => ({ETag: n === 2 ? '"0"' : '"1"'})), ['1,1,1', 1]);
});

test('the first request asks for what is new, later ones take what a cache has, one at a time; or none does', () => withServer({}, async server => {
  /** @param {any} [options] @param {any[]} asks that are sent at once */
  const modes = async (options, ...asks) => {
    const seen = /** @type {any[]} */ ([]);
    const link = new Link(server.url, {...options, fetch: (/** @type {any} */ url, /** @type {any} */ init) => { seen.push(init.cache); return fetch(url, init); }});
    await ask(link, server.url, {size: 10});
    await Promise.all(asks.map(one => ask(link, server.url, {size: 10, ...one})));
    await ask(link, server.url, {size: 10});
    return seen;
  };
  assert.deepEqual(await modes({}, {}, {}), ['no-cache', 'default', 'no-store', 'default']);
  assert.deepEqual(await modes({}, {isFresh: true}, {isWhole: true}, {isPlaylist: true}), ['no-cache', 'reload', 'no-cache', 'no-cache', 'default']);
  assert.deepEqual(await modes({cache: 'no-store'}, {}), ['no-store', 'no-store', 'no-store']);
}));

test('several servers: what fails at one comes from the next, which has tags of its own', () => withServer({etag: () => '"a"'}, first =>
  withServer({etag: () => '"b"'}, async second => {
    const folders = [first, second].map(({url}) => url.replace('scene.l4d', ''));
    for (const [bases, fault] of /** @type {[string[], any][]} */ ([
      [['http://127.0.0.1:9/', folders[0]], undefined], [folders, 404], [folders, 'cut'], [folders, 503]
    ])) {
      const before = second.seen.length;
      let count = 0;
      first.answer = () => ++count > 1 ? fault : undefined;
      await play(`${bases[0]}scene.l4d`, {bases});
      assert.equal(second.seen.length > before, fault !== undefined, `${fault}`);
    }
    const {engine} = await engineOf(new Link('http://127.0.0.1:9/a', {bases: ['http://127.0.0.1:9/', 'http://127.0.0.1:9/b/']}), {failures: 2}, 'http://127.0.0.1:9/a');
    await assert.rejects(engine.open(), {code: 'NETWORK'});
    engine.dispose();
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

test('an answer that does not come names the other origin as what may forbid it', () => {
  const {location} = /** @type {any} */ (globalThis);
  try {
    Object.assign(globalThis, {location: {origin: 'http://here.org'}});
    assert.match(fetchError('http://other.org/a.l4d', new TypeError('Failed to fetch')).message, /Failed to fetch; .*Access-Control-Allow-Origin/);
    assert.equal(fetchError('http://here.org/a.l4d', new TypeError('Failed to fetch')).message, 'http://here.org/a.l4d: Failed to fetch');
    assert.ok(fetchError('http://here.org/a.l4d', new TypeError('x')) instanceof L4DError);
  } finally {
    Object.assign(globalThis, {location});
  }
});
