// SPDX-License-Identifier: Apache-2.0
// `l4dcodec view` in browsers: the player that is built into the tool, under the tool's own rules for pages.
import assert from 'node:assert/strict';
import {spawn} from 'node:child_process';
import {once} from 'node:events';
import {copyFileSync, mkdirSync, mkdtempSync, renameSync, rmSync} from 'node:fs';
import {tmpdir} from 'node:os';
import {join} from 'node:path';
import {createInterface} from 'node:readline';
import {test} from 'node:test';
import {complaints, launch, newPage, opened, work} from './browser.js';
import {recording} from './recording.js';

/** Runs the tool. url: '' where it ends at once. @param {string} input */
const view = async input => {
  const tool = spawn(/** @type {string} */ (process.env.L4D_TOOL), ['view', input, '--no-browser']);
  const ended = once(tool, 'exit');
  let complaint = '';
  tool.stderr.on('data', text => { complaint += text; });
  const url = await new Promise(resolve => {
    const lines = createInterface(tool.stdout);
    lines.once('line', resolve);
    lines.once('close', () => resolve(''));
  });
  if (!url) await ended;
  return {tool, ended, url, complaint: () => complaint};
};

/**
 * Calls fn with a page, at the address at which the tool shows `input`, and ends the tool by a signal.
 * @param {import('node:test').TestContext} t @param {string} input
 * @param {(page: any) => Promise<void>} fn
 */
const withView = async (t, input, fn) => {
  const {tool, ended, url, complaint} = await view(input);
  if (!url) {
    assert.match(complaint(), /not in this build|no HTTP server/);
    return t.skip('the tool was built without the player');
  }
  const browser = await launch();
  try {
    const page = await newPage(browser, {viewport: {width: 320, height: 180}});
    await page.goto(url);
    await fn(page);
    assert.deepEqual(await complaints(page), []);
  } finally {
    await browser.close();
    tool.kill('SIGINT');
  }
  assert.equal((await ended)[0], 0, complaint());
};

test('l4dcodec view plays a stream, and ends at a signal', t => withView(t, join(work, 'short.l4d'), async page => {
  await opened(page);
  const [count, sum] = await page.evaluate(async () => {
    const {movie, view} = document.querySelector('l4d-player');
    movie.pause();
    await movie.seek(1.5);
    const pixels = await view.pixels();
    return [(await movie.slice(1.5)).count, pixels.reduce((a, b, k) => a + (k % 4 === 3 ? 0 : b), 0) / pixels.length];
  });
  assert.ok(count > 1000 && sum > 5, `${count} splats, ${sum} on average`);
}));

test('l4dcodec view follows a file that grows', async t => {
  const folder = mkdtempSync(join(tmpdir(), 'l4dview-'));
  t.after(() => rmSync(folder, {recursive: true}));
  const live = recording(join(work, 'members'), folder);
  live.publish(4);
  await withView(t, live.file, async page => {
    await opened(page);
    const state = () => page.evaluate(() => {
      const {movie} = document.querySelector('l4d-player');
      return {live: movie.live, duration: movie.duration, streams: movie.streamsAt(movie.currentTime).length};
    });
    const first = await state();
    assert.ok(first.live && Math.abs(first.duration - 4) < 1e-3 && first.streams >= 2, JSON.stringify(first));
    live.publish(6);
    await page.waitForFunction(() => document.querySelector('l4d-player').movie.duration > 5.9);
    live.publish(Infinity);
    await page.waitForFunction(() => !document.querySelector('l4d-player').movie.live);
    assert.ok(Math.abs((await state()).duration - 8) < 1e-3);
    // What is shown at the end of it has come, too.
    const count = await page.evaluate(async () => {
      const {movie} = document.querySelector('l4d-player');
      movie.pause();
      await movie.seek(7.5);
      return (await movie.slice(7.5)).count;
    });
    assert.ok(count > 1000, `${count} splats`);
  });
});

test('l4dcodec view shows a file again that has become another one, from the same place', async t => {
  const folder = mkdtempSync(join(tmpdir(), 'l4dview-'));
  t.after(() => rmSync(folder, {recursive: true}));
  const file = join(folder, 'scene.l4d');
  copyFileSync(join(work, 'short.l4d'), file);
  await withView(t, file, async page => {
    await opened(page);
    const before = await page.evaluate(() => {
      const player = document.querySelector('l4d-player');
      player.pointer.turn(0.5, 0.1);
      return [player.movie.info.numGaussians, String(player.view.orbit)];
    });
    copyFileSync(join(work, 'frames.l4d'), join(folder, 'next'));
    renameSync(join(folder, 'next'), file);
    await page.waitForFunction(count => {
      const {movie, isOpen} = document.querySelector('l4d-player');
      return isOpen && movie.info.numGaussians !== count;
    }, before[0]);
    assert.equal(await page.evaluate(() => String(document.querySelector('l4d-player').view.orbit)), before[1]);
  });
});

test('l4dcodec view of a folder lists its streams, and each plays', async t => {
  const folder = mkdtempSync(join(tmpdir(), 'l4dview-'));
  t.after(() => rmSync(folder, {recursive: true}));
  mkdirSync(join(folder, 'more'));
  copyFileSync(join(work, 'short.l4d'), join(folder, 'more/50% & <more>.l4d'));
  await withView(t, folder, async page => {
    await page.getByRole('link', {name: 'more/'}).click();
    await page.getByRole('link', {name: '50% & <more>.l4d'}).click();
    await opened(page);
    assert.ok(await page.evaluate(() => document.querySelector('l4d-player').movie.info.numGaussians) > 1000);
  });
});
