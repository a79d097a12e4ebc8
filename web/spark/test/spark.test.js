// SPDX-License-Identifier: Apache-2.0
// The example of the adapter, in Chromium: its page is the test.
import assert from 'node:assert/strict';
import {join} from 'node:path';
import {after, before, test} from 'node:test';
import {complaints, launch, serve, work} from '../../test/browser.js';
import {checkHiding, fidelities, madeCameras, openExample} from '../../test/engine-page.js';

const stream = join(work, 'short.l4d');
const leastDb = 45;
/** @type {any} */
let browser, server, page;
before(async () => {
  browser = await launch();
  server = await serve({'scene.l4d': stream}, {}, 'build/web/spark');
  page = await openExample(browser, server.url);
});
after(async () => {
  await browser?.close();
  server?.close();
});

test(`Spark draws what l4dcodec render draws, at ${leastDb} dB, and with its SH`, async () => {
  const found = await fidelities(page, stream, [[0.2, 0], [1.5, 1], [3, 2]], 'Spark');
  assert.ok(Math.min(...found) >= leastDb, found.join(' '));
  assert.ok(await page.evaluate(() => /** @type {any} */ (globalThis).example.movie.info.shDegree) > 0);
});

test('flat windows are seen in their frames', async () => {
  const frames = join(work, 'frames.l4d');
  const other = await serve({'scene.l4d': frames}, {}, 'build/web/spark');
  const second = await openExample(browser, other.url);
  try {
    const found = await fidelities(second, frames, [[0, 0], [7 / 30, 1], [0.99, 2]], 'Spark');
    assert.ok(Math.min(...found) >= leastDb, found.join(' '));
  } finally {
    await second.close();
    other.close();
  }
});

test('streams that follow each other, whose colours have other degrees', async () => {
  const joined = join(work, 'joined.l4d');
  const other = await serve({'joined.m3u8': join(work, 'joined.m3u8'), 'joined.l4d': joined}, {}, 'build/web/spark');
  const second = await openExample(browser, `${other.url}?src=joined.m3u8`);
  try {
    const found = await fidelities(second, joined, [[0.5, 0], [1.01, 0], [3, 1], [0.2, 2]], 'Spark');
    assert.ok(Math.min(...found) >= leastDb, found.join(' '));
  } finally {
    await second.close();
    other.close();
  }
});

test('the picture moves: from seek to seek, and while it plays', async () => {
  const {changed, again, played, shown} = await page.evaluate(async camera => {
    const {tools, example} = /** @type {any} */ (globalThis);
    const {movie, splats, mesh, draw} = example;
    const differing = (a, b) => a.reduce((sum, v, k) => sum + (Math.abs(v - b[k]) > 2 ? 1 : 0), 0) / a.length;
    mesh.visible = false;
    tools.look(camera, 320, 240);
    const at = async time => { await tools.seek(time); return tools.picture(); };
    const [first, second, third] = [await at(0.5), await at(3), await at(0.5)];
    movie.loop = false;
    movie.play();
    const began = movie.currentTime;
    while (movie.currentTime < began + 0.5) {
      draw();
      await new Promise(resolve => requestAnimationFrame(resolve));
    }
    movie.pause();
    const fourth = await tools.picture();
    return {changed: differing(first, second), again: differing(first, third), played: differing(first, fourth), shown: splats.shownTime - began};
  }, madeCameras[0]);
  console.log(`changed: ${(100 * changed).toFixed(1)} % by a seek, ${(100 * played).toFixed(1)} % by playing`);
  assert.equal(again, 0, 'the same instant, the same picture');
  assert.ok(changed > 0.02 && played > 0.002, `${changed} ${played}`);
  assert.ok(shown >= 0.5, `${shown} s`);
});

test('a mesh hides splats behind it, and splats hide a mesh behind them', () => checkHiding(page));

test('what is disposed of is gone', async () => {
  const lit = await page.evaluate(async () => {
    const {tools, example} = /** @type {any} */ (globalThis);
    example.mesh.visible = false;
    example.splats.dispose();
    const pixels = await tools.picture();
    example.movie.dispose();
    return pixels.reduce((sum, v, k) => sum + (k % 4 === 3 ? 0 : v), 0);
  });
  assert.equal(lit, 0);
  assert.deepEqual(await complaints(page), []);
});
