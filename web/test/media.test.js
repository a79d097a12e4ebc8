// SPDX-License-Identifier: Apache-2.0
// <l4d-player> where pages expect a <video>: events in their order, properties, and the controls of media-chrome.
import assert from 'node:assert/strict';
import {execFileSync} from 'node:child_process';
import {mkdtempSync, rmSync} from 'node:fs';
import {tmpdir} from 'node:os';
import {join} from 'node:path';
import {after, before, test} from 'node:test';
import {complaints, launch, newPage, serve, work} from './browser.js';

const root = process.env.L4D_ROOT ?? new URL('../..', import.meta.url).pathname;
const folder = mkdtempSync(join(tmpdir(), 'l4dmedia-'));
let browser, server;
before(async () => {
  execFileSync(join(root, 'web/node_modules/.bin/esbuild'), [
    join(root, 'web/node_modules/media-chrome/dist/index.js'), '--bundle', '--format=esm', `--outfile=${folder}/chrome.js`, '--log-level=error']);
  browser = await launch();
  server = await serve({'scene.l4d': join(work, 'short.l4d'), 'chrome.js': join(folder, 'chrome.js')});
});
after(async () => {
  await browser?.close();
  server?.close();
  rmSync(folder, {recursive: true});
});

/** @param {string} body @param {(page: any) => Promise<void>} fn @param {RegExp} [errors] what the page may complain of */
const withPage = async (body, fn, errors) => {
  server.faults.page = {body: `<!doctype html><link rel="icon" href="data:,"><body>${body}<script type="module" src="player.js"></script>`};
  const page = await newPage(browser, {viewport: {width: 640, height: 400}});
  try {
    await page.goto(`${server.url}page.html`);
    await page.waitForFunction(() => Boolean(customElements.get('l4d-player')));
    await fn(page);
    assert.deepEqual((await complaints(page)).filter(error => !errors?.test(error)), []);
  } finally {
    await page.close();
  }
};

test('events come in the order of media elements, and properties say what they say there', () => withPage('<l4d-player></l4d-player>', async page => {
  const found = await page.evaluate(async () => {
    const player = document.querySelector('l4d-player');
    const types = ['abort', 'emptied', 'loadstart', 'durationchange', 'loadedmetadata', 'loadeddata', 'canplay', 'canplaythrough', 'play', 'playing',
                   'waiting', 'pause', 'seeking', 'seeked', 'ended', 'volumechange', 'error', 'progress', 'timeupdate'];
    let seen = [];
    for (const type of types) player.addEventListener(type, () => { if (!['progress', 'timeupdate'].includes(type)) seen.push(type); });
    const taken = () => seen.splice(0);
    const found = {empty: [player.readyState, player.networkState, player.buffered.length, player.seekable.length, player.error, player.controls, player.preload]};
    const opening = player.load('scene.l4d');
    found.loading = [player.readyState, player.networkState];
    await opening;
    found.load = taken();
    found.open = [player.readyState >= 2, player.networkState, player.seekable.length, player.seekable.start(0), player.seekable.end(0), player.seeking];
    player.currentTime = 2;
    found.seeking = [player.seeking, ...taken()];
    await new Promise(resolve => player.addEventListener('seeked', resolve, {once: true}));
    found.sought = [player.seeking, player.currentTime, ...taken()];
    for (const time of [1, 2.5, 3]) player.currentTime = time;
    await new Promise(resolve => player.addEventListener('seeked', resolve, {once: true}));
    found.many = taken();
    await player.play();
    player.pause();
    found.played = taken().filter(type => type !== 'waiting');
    player.currentTime = 3.8;
    await new Promise(resolve => player.addEventListener('seeked', resolve, {once: true}));
    taken();
    await player.play();
    await new Promise(resolve => player.addEventListener('ended', resolve, {once: true}));
    found.ended = taken().filter(type => type !== 'waiting');
    found.buffered = player.buffered.length > 0 && player.buffered.end(0) > 0;
    const audio = new Audio();
    player.muted = true;
    player.volume = 0.5;
    player.volume = 0.5;
    player.sync(audio);
    player.sync(null);
    found.sound = [audio.muted, audio.volume, ...taken()];
    found.code = await player.load('missing.l4d').catch(() => player.error.code);
    found.failed = [player.readyState, player.networkState, ...taken()];
    void player.load('scene.l4d').catch(() => {});
    player.unload();
    found.aborted = taken();
    player.controls = false;
    found.bar = getComputedStyle(player.shadowRoot.querySelector('.bar')).display;
    try { player.buffered.start(7); } catch (error) { found.range = error.name; }
    return found;
  });
  assert.deepEqual({...found, ended: found.ended.slice(-2)}, {
    empty: [0, 0, 0, 0, null, true, 'auto'], loading: [0, 2],
    load: ['loadstart', 'durationchange', 'loadedmetadata', 'loadeddata', 'canplay', 'canplaythrough'], open: [true, 1, 1, 0, 4, false],
    seeking: [true, 'seeking'], sought: [false, 2, 'seeked'], many: ['seeking', 'seeking', 'seeking', 'seeked'], played: ['play', 'playing', 'pause'],
    ended: ['pause', 'ended'], buffered: true, sound: [true, 0.5, 'volumechange', 'volumechange'], code: 4,
    failed: [0, 3, 'emptied', 'loadstart', 'error'], aborted: ['loadstart', 'abort', 'emptied'], bar: 'none', range: 'IndexSizeError'
  });
}, /404/));

test('controls of media-chrome play, pause, seek and show the time', () => withPage(
  `<media-controller style="width: 480px"><l4d-player slot="media" src="scene.l4d" controls="none" loop></l4d-player>
   <media-control-bar><media-play-button></media-play-button><media-time-range></media-time-range><media-time-display showduration></media-time-display>
   <media-mute-button></media-mute-button></media-control-bar></media-controller><script type="module" src="chrome.js"></script>`, async page => {
    await page.waitForFunction(() => document.querySelector('l4d-player').isOpen);
    await page.waitForFunction(() => document.querySelector('media-controller').getAttribute('mediaduration') === '4');
    if (process.env.L4D_SHOTS) await page.screenshot({path: join(process.env.L4D_SHOTS, 'media-chrome.png')});
    await page.click('media-play-button');
    await page.waitForFunction(() => !document.querySelector('l4d-player').paused && !document.querySelector('media-controller').hasAttribute('mediapaused'));
    await page.waitForFunction(() => Number(document.querySelector('media-controller').getAttribute('mediacurrenttime')) > 0.2);
    await page.click('media-play-button');
    await page.waitForFunction(() => document.querySelector('l4d-player').paused);
    await page.evaluate(() => document.querySelector('media-controller').dispatchEvent(
      new CustomEvent('mediaseekrequest', {detail: 3, bubbles: true, composed: true})));
    await page.waitForFunction(() => document.querySelector('l4d-player').currentTime === 3 && !document.querySelector('l4d-player').seeking);
    await page.click('media-mute-button');
    await page.waitForFunction(() => document.querySelector('l4d-player').muted);
  }));
