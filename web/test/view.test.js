// SPDX-License-Identifier: Apache-2.0
// `l4dcodec view` in Chromium: the player that is built into the tool, under the tool's own rules for pages.
import assert from 'node:assert/strict';
import {spawn} from 'node:child_process';
import {once} from 'node:events';
import {join} from 'node:path';
import {createInterface} from 'node:readline';
import {test} from 'node:test';
import {launch, newPage, opened, work} from './browser.js';

test('l4dcodec view plays a stream, and ends at a signal', async t => {
  const tool = spawn(/** @type {string} */ (process.env.L4D_TOOL), ['view', join(work, 'short.l4d'), '--no-browser']);
  const ended = once(tool, 'exit');
  let complaint = '';
  tool.stderr.on('data', text => { complaint += text; });
  const url = await new Promise(resolve => {
    const lines = createInterface(tool.stdout);
    lines.once('line', resolve);
    lines.once('close', () => resolve(''));
  });
  if (!url) {
    await ended;
    assert.match(complaint, /not in this build|no HTTP server/);
    return t.skip('the tool was built without the player');
  }
  const browser = await launch();
  try {
    const page = await newPage(browser, {viewport: {width: 480, height: 270}});
    await page.goto(url);
    await opened(page);
    const [count, sum] = await page.evaluate(async () => {
      const {movie, view} = document.querySelector('l4d-player');
      movie.pause();
      await movie.seek(1.5);
      const pixels = await view.pixels();
      return [(await movie.slice(1.5)).count, pixels.reduce((a, b, k) => a + (k % 4 === 3 ? 0 : b), 0) / pixels.length];
    });
    assert.ok(count > 1000 && sum > 5, `${count} splats, ${sum} on average`);
    assert.deepEqual(page.errors, []);
  } finally {
    await browser.close();
    tool.kill('SIGINT');
  }
  const [status] = await ended;
  assert.equal(status, 0, complaint);
});
