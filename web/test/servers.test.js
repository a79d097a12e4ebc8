// SPDX-License-Identifier: Apache-2.0
// Streams on real servers: of the origin of the page and of another one, over HTTP/1.1 and HTTP/2.
import assert from 'node:assert/strict';
import {spawnSync} from 'node:child_process';
import {chmodSync, copyFileSync, mkdirSync, mkdtempSync, readdirSync, readFileSync, rmSync, writeFileSync} from 'node:fs';
import {tmpdir} from 'node:os';
import {join} from 'node:path';
import {after, before, test} from 'node:test';
import {browserName, launch, newPage, serve, work} from './browser.js';
import * as servers from './servers.js';

const root = process.env.L4D_ROOT ?? new URL('../..', import.meta.url).pathname;
const stream = join(work, 'tiers.l4d');
const size = readFileSync(stream).length;
const temporary = mkdtempSync(join(tmpdir(), 'l4dservers-'));
/** @type {servers.Place} */
let place;
let browser, home;

before(async () => {
  chmodSync(temporary, 0o755);  // nginx reads files as nobody
  const folder = join(temporary, 'files');
  mkdirSync(folder);
  const player = join(root, 'build/web/player');
  for (const name of readdirSync(player)) copyFileSync(join(player, name), join(folder, name));
  copyFileSync(stream, join(folder, 'scene.l4d'));
  writeFileSync(join(folder, 'blank.html'), '<!doctype html><link rel="icon" href="data:,">');
  place = {folder, work: temporary, certificate: servers.makeCertificate(temporary)};
  home = await serve({'scene.l4d': stream, 'blank.html': join(folder, 'blank.html')}, {headers: {'Content-Type': 'text/html'}});
  browser = await launch();
});
after(async () => {
  await browser?.close();
  home?.close();
  rmSync(temporary, {recursive: true});
});

/** Opens, seeks to three instants, and counts the Gaussians of each. @param {any} page @param {string} url */
const play = (page, url) => page.evaluate(async address => {
  const {open} = await import('/player.js');
  const movie = await open(address);
  try {
    const counts = [];
    for (const share of [0.5, 0.95, 0.1]) {
      await movie.seek(movie.timeBegin + share * movie.duration);
      counts.push((await movie.slice(movie.currentTime, {sh: false})).count);
    }
    return {counts, bytes: movie.info.fileBytes};
  } finally {
    movie.dispose();
  }
}, url);

/** @param {string} url of the page @param {(page: any) => Promise<any>} fn */
const onPage = async (url, fn) => {
  const page = await newPage(browser, {ignoreHTTPSErrors: true});
  try {
    await page.goto(`${url}blank.html`);
    return await fn(page);
  } finally {
    await page.close();
  }
};

let requested = 0;
/** The log of all that has been requested until now: it ends where one more request has come into it. @param {servers.Running} server */
const logOf = async server => {
  const mark = `?last=${++requested}`;
  await (await fetch(`${server.urls[1]}scene.l4d${mark}`)).arrayBuffer();
  for (const end = Date.now() + 60000; Date.now() < end;) {
    server.flush?.();
    await new Promise(resolve => setTimeout(resolve, 25));
    const log = server.log();
    if (log.some(({path, status}) => path.endsWith(mark) && status > 0)) return log.filter(({path}) => !path.includes('?last='));
  }
  throw new Error(`waited in vain for ${mark} in the log`);
};

/** @param {string} program */
const lacks = program => ['nginx', 'lighttpd'].includes(program) && spawnSync(program, ['-v']).error !== undefined;
const expected = {};
for (const [name, start] of Object.entries({
  nginx: servers.nginx, lighttpd: servers.lighttpd, 'python3 -m http.server': servers.python, 'serve-static': servers.serveStatic,
  'as S3 answers': servers.s3, 'a CDN that compresses': servers.cdn
})) {
  test(name, async t => {
    if (lacks(name)) return t.skip(`no ${name} (./dev setup web)`);
    const server = await start(place);
    try {
      for (const [version, url] of Object.entries(server.urls)) {
        for (const origin of ['same', 'other']) {
          await t.test(`HTTP/${version}, ${origin} origin`, async () => {
            // Of what pages before have cancelled there may still come something.
            const mark = `?page=${++requested}`;
            const found = await onPage(origin === 'same' ? url : home.url, page => play(page, `${url}scene.l4d${mark}`)).catch(error => error);
            const log = (await logOf(server)).filter(({path}) => path.endsWith(mark));
            if (name.startsWith('python') && origin === 'other') {
              // It has no setting that lets pages of others read what it has.
              assert.match(String(found), /Access-Control-Allow-Origin/);
              return;
            }
            assert.equal(found.bytes, size, String(found));
            expected.counts ??= found.counts;
            assert.deepEqual(found.counts, expected.counts);
            assert.ok(found.counts.every(n => n > 0));
            assert.ok(log.length > 0 && log.every(({method}) => method === 'GET'), JSON.stringify(log));
            assert.ok(log.every(entry => entry.version === (version === '1' ? 'HTTP/1.1' : 'HTTP/2.0')), JSON.stringify(log));
            const hasRanges = !name.startsWith('python') && !name.includes('compresses');
            // A request that is cancelled may have any.
            const wanted = hasRanges ? 206 : 200;
            assert.ok(log.filter(({status}) => status === wanted).length >= log.length - 2, JSON.stringify(log));
            console.log(`| ${name} | HTTP/${version} | ${origin} | ${log.length} requests, ${hasRanges ? 'ranges' : 'whole'} |`);
          });
        }
      }
    } finally {
      server.close();
    }
  });
}

/** What a server was asked for by two loads of a browser that has nothing of it yet. */
async function loadTwice(server) {
  const context = await browser.newContext({ignoreHTTPSErrors: true});
  try {
    const logs = [];
    for (let k = 0; k < 2; ++k) {
      const from = (await logOf(server)).length;
      const page = await context.newPage();
      await page.goto(`${server.urls[1]}blank.html`);
      await play(page, `${server.urls[1]}scene.l4d`);
      await page.close();
      logs.push((await logOf(server)).slice(from));
    }
    return logs;
  } finally {
    await context.close();
  }
}

test('what the browser has kept is good if the server says so', async t => {
  if (lacks('nginx')) return t.skip('no nginx (./dev setup web)');
  if (browserName === 'Firefox') {
    console.log('SKIPPED: what the browser has kept: Firefox keeps no parts of files');
    return t.skip('Firefox keeps no parts of files');
  }
  const server = await servers.nginx(place);
  try {
    // The browser drops what it has of a file where ranges of it arrive side by side, now and then.
    for (let attempt = 0; ; ++attempt) {
      const logs = await loadTwice(server);
      assert.ok(logs[0].every(({status}) => status === 206), JSON.stringify(logs));
      if (logs[1].some(({status}) => status === 304)) {
        console.log(`fetched at first, and again: ${logs.map(log => log.reduce((sum, entry) => sum + entry.bytes, 0))} bytes`);
        return;
      }
      assert.ok(attempt < 4, JSON.stringify(logs));
    }
  } finally {
    server.close();
  }
});
