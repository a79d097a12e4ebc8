// SPDX-License-Identifier: Apache-2.0
// What tests in browsers share: a server of the player's files and of streams, with faults, and pages.
import assert from 'node:assert/strict';
import {createServer} from 'node:http';
import {readFileSync} from 'node:fs';
import {extname, join} from 'node:path';

export const root = process.env.L4D_ROOT ?? new URL('../..', import.meta.url).pathname;
export const work = process.env.L4D_WORK ?? join(root, 'build/release/web');
const types = {'.html': 'text/html', '.js': 'text/javascript', '.svg': 'image/svg+xml', '.vtt': 'text/vtt', '.wasm': 'application/wasm'};
const sleep = ms => new Promise(resolve => setTimeout(resolve, ms));

/**
 * @typedef {object} Faults of the stream: no ranges, a tag, a status, Mbit/s, ms before each answer, what answers from a byte on wait for,
 * headers of all answers, what page.html is, what others of the player's files are
 * @property {boolean} [ranges] @property {string} [etag] @property {number} [status] @property {number} [rate]
 * @property {number} [delay] @property {(begin: number) => Promise<void> | undefined} [hold]
 * @property {Record<string, string>} [headers] @property {{body: string, headers?: Record<string, string>}} [page]
 * @property {Record<string, {status: number, type: string}>} [instead]
 */

/**
 * @param {Record<string, string>} streams name to path @param {Faults} [faults] may be changed later
 * @param {string} [folder] of the files beside them @param {Record<string, string>} [headers] of these
 */
export const serve = async (streams, faults = {}, folder = 'build/web/player', headers = {}) => {
  const requests = [], methods = [], names = [];
  let busyUntil = 0;
  const server = createServer(async (request, response) => {
    const name = new URL(request.url ?? '/', 'http://x').pathname.slice(1) || 'index.html';
    names.push(name);
    if (name === 'page.html' && faults.page) {
      return response.writeHead(200, {'Content-Type': 'text/html', ...faults.page.headers}).end(faults.page.body);
    }
    if (faults.instead?.[name]) {
      const {status, type} = faults.instead[name];
      return response.writeHead(status, {'Content-Type': type}).end('<!doctype html>');
    }
    if (!(name in streams)) {
      try {
        const body = readFileSync(join(root, folder, name));
        response.writeHead(200, {'Content-Type': types[extname(name)] ?? 'application/octet-stream', ...headers}).end(body);
      } catch {
        response.writeHead(404).end();
      }
      return;
    }
    methods.push(request.method);
    if (request.method === 'OPTIONS') return response.writeHead(405).end();
    const bytes = readFileSync(streams[name]);
    const match = /^bytes=(\d+)-(\d*)$/.exec(request.headers.range ?? '');
    await faults.hold?.(Number(match?.[1] ?? 0));
    const etag = faults.etag ?? '"1"';
    // With If-Range a browser asks whether the part that it keeps is still a part of this file. An answer with a part
    // means yes, an answer with the whole file means no.
    const isSame = (request.headers['if-range'] ?? etag) === etag;
    const part = match && faults.ranges !== false && isSame;
    const begin = part ? Number(match[1]) : 0;
    const end = part && match[2] ? Math.min(Number(match[2]) + 1, bytes.length) : bytes.length;
    requests.push([begin, end - begin]);
    if (faults.delay) await sleep(faults.delay);
    if (faults.status || begin >= bytes.length) return response.writeHead(faults.status ?? 416).end();
    response.writeHead(part ? 206 : 200, {
      'Content-Length': end - begin, ETag: etag, ...types[extname(name)] && {'Content-Type': types[extname(name)]}, ...faults.headers,
      ...part && {'Content-Range': `bytes ${begin}-${end - 1}/${bytes.length}`}
    });
    for (let at = begin; at < end; at += 16384) {
      const piece = bytes.subarray(at, Math.min(at + 16384, end));
      if (faults.rate) {
        // One line, which all requests share.
        busyUntil = Math.max(busyUntil, performance.now()) + piece.length * 8 / (faults.rate * 1000);
        await sleep(busyUntil - performance.now());
      }
      if (response.destroyed) return;
      response.write(piece);
    }
    response.end();
  });
  await new Promise(resolve => server.listen(0, '127.0.0.1', () => resolve(undefined)));
  return {
    url: `http://127.0.0.1:${server.address().port}/`, requests, methods, names, faults,
    close: () => { server.closeAllConnections(); server.close(); }
  };
};

// L4D_BROWSER: chromium (default) or firefox.
const driver = await import(process.env.L4D_BROWSER === 'firefox' ? './firefox.js' : './chromium.js');

/** What draws. */
export const browserName = driver.name;

/**
 * @param {{webgpu?: boolean, gpu?: boolean, webgl?: boolean}} [options] webgpu: on the processor, gpu: what the GPU offers over EGL;
 * webgl: false: there is none
 * @returns {Promise<any>}
 */
export const launch = driver.launch;

/**
 * Fingers on a page: start() and move() take the place of each, end() lifts all of them.
 * @param {any} page
 * @returns {Promise<{start(points: number[][]): Promise<void>, move(points: number[][]): Promise<void>, end(): Promise<void>}>}
 */
export const touch = driver.touch;

/**
 * Collects what no page needs any longer, and says what is there: bytes of scripts, nodes and listeners.
 * @param {any} page @returns {Promise<{bytes: number, nodes: number, listeners: number}>}
 */
export const heap = driver.heap;

/** An empty page of a server, which modules can be imported into. @param {any} browser @param {string} url */
export const blankPage = async (browser, url) => {
  const page = await newPage(browser);
  await page.route('**/blank.html', route => route.fulfill({contentType: 'text/html', body: '<!doctype html><body>'}));
  await page.goto(`${url}blank.html`);
  return page;
};

/** Says aloud where this browser offers no WebGPU. @param {any} page @returns {Promise<boolean>} */
export const hasWebGpu = async page => {
  const has = await page.evaluate(async () => Boolean(await navigator.gpu?.requestAdapter()));
  if (!has) console.log(`SKIPPED: WebGPU: this ${browserName} has no adapter`);
  return has;
};

/** In pages: waits until the condition holds. @param {() => unknown} condition @param {string} what */
const until = async (condition, what) => {
  for (const end = performance.now() + 60000; performance.now() < end;) {
    if (await condition()) return;
    await new Promise(resolve => setTimeout(resolve, 20));
  }
  throw new Error(`waited in vain for ${what}`);
};

/** A page whose errors are collected, and which has until(). @param {any} browser @param {any} [options] */
export const newPage = async (browser, options = {}) => {
  const page = await browser.newPage({viewport: {width: 960, height: 540}, ...options});
  await page.addInitScript(`globalThis.until = ${until}`);
  page.setDefaultTimeout(60000);
  const wait = page.waitForFunction.bind(page);
  page.waitForFunction = (/** @type {any[]} */ ...given) => wait(...given).catch((/** @type {any} */ error) => {
    throw error.name === 'TimeoutError' ? new Error(`waited in vain for ${given[0]}\n${page.errors.join('\n')}`, {cause: error}) : error;
  });
  page.errors = [];
  page.on('pageerror', error => page.errors.push(String(error)));
  page.on('console', message => {
    if (message.type() === 'error' || message.text().includes('WebGL: INVALID')) page.errors.push(message.text());
  });
  return page;
};

/**
 * What a page has complained of until now.
 * @param {any} page @returns {Promise<string[]>}
 */
export const complaints = async page => {
  await driver.allSaid(page);
  return page.errors;
};

/** Waits until the player shows its first picture. @param {any} page */
export const opened = page => page.waitForFunction(() => {
  const player = document.querySelector('l4d-player');
  return player?.isOpen && player.shadowRoot.querySelector('.poster').classList.contains('gone');
}, undefined, {timeout: 120000});

/** Fingers that move in steps from one place to another. @param {any} page @param {number[][][]} ways of each finger: from and to */
export const swipe = async (page, ways) => {
  const {start, move, end} = await touch(page);
  const at = (/** @type {number} */ step) =>
    ways.map(([from, to]) => from.map((begin, axis) => begin + (to[axis] - begin) * step / 8));
  await start(at(0));
  for (let step = 1; step <= 8; ++step) await move(at(step));
  await end();
};

/**
 * Runs fn with a page of this body, which may not complain.
 * @param {any} browser @param {{url: string}} server @param {string} body @param {(page: any) => Promise<void>} fn
 * @param {{hash?: string, headers?: Record<string, string>, size?: [number, number], script?: string, errors?: RegExp, options?: any}} [how]
 *   errors: what it may complain of; options: of the page
 */
export const pageWith = async (browser, server, body, fn, {hash = '', headers = {}, size = [480, 270], script = 'player.js', errors,
                                                           options} = {}) => {
  const page = await newPage(browser, {viewport: {width: size[0], height: size[1]}, ...options});
  try {
    await page.route('**/page.html', route => route.fulfill({
      contentType: 'text/html', headers: {'content-type': 'text/html', ...headers},
      body: `<!doctype html><body>${body}${script && `<script type="module" src="${script}"></script>`}`
    }));
    await page.goto(`${server.url}page.html${hash}`);
    await fn(page);
    assert.deepEqual((await complaints(page)).filter(error => !errors?.test(error)), []);
  } finally {
    await page.close();
  }
};
