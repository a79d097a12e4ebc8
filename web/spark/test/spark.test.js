// SPDX-License-Identifier: Apache-2.0
// The example of the adapter, in Chromium: its page is the test.
import assert from 'node:assert/strict';
import {join} from 'node:path';
import {after, before, test} from 'node:test';
import {launch, serve, work} from '../../test/browser.js';
import {madeCameras, openExample, rendered} from './page.js';

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

/** @param {any} page @param {string} stream @param {[number, number][]} views times and cameras */
const fidelities = async (page, stream, views) => {
  const found = [];
  for (const [time, k] of views) {
    const camera = madeCameras[k];
    found.push(await page.evaluate(async ({camera, time, png}) => {
      const {tools, example} = /** @type {any} */ (globalThis);
      example.mesh.visible = false;
      example.splats.rotation.x = 0;
      tools.look(camera, 320, 240);
      await tools.seek(time);
      return tools.psnr(await tools.picture(), png);
    }, {camera, time, png: rendered(stream, camera, time, [320, 240])}));
  }
  console.log(`Spark against l4dcodec render: ${found.map(v => v.toFixed(2)).join(', ')} dB`);
  assert.deepEqual(page.errors, []);
  return found;
};

test(`Spark draws what l4dcodec render draws, at ${leastDb} dB, and with its SH`, async () => {
  const found = await fidelities(page, stream, [[0.2, 0], [1.5, 1], [3, 2]]);
  assert.ok(Math.min(...found) >= leastDb, found.join(' '));
  assert.ok(await page.evaluate(() => /** @type {any} */ (globalThis).example.movie.info.shDegree) > 0);
});

test('flat windows are seen in their frames', async () => {
  const frames = join(work, 'frames.l4d');
  const other = await serve({'scene.l4d': frames}, {}, 'build/web/spark');
  const second = await openExample(browser, other.url);
  try {
    const found = await fidelities(second, frames, [[0, 0], [7 / 30, 1], [0.99, 2]]);
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
    const found = await fidelities(second, joined, [[0.5, 0], [1.01, 0], [3, 1], [0.2, 2]]);
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

test('a mesh hides splats behind it, and splats hide a mesh behind them', async () => {
  const found = await page.evaluate(async camera => {
    const {tools, example} = /** @type {any} */ (globalThis);
    const {mesh, splats} = example;
    tools.look(camera, 320, 240);
    splats.rotation.x = 0;
    mesh.visible = true;
    await tools.seek(1);
    // Pixels of the mesh's colour alone, without and with splats.
    const green = async (z, scale) => {
      mesh.position.set(0, -0.5, z);
      mesh.scale.setScalar(scale);
      const counts = [];
      for (splats.visible of [false, true]) {
        const pixels = await tools.picture();
        let count = 0;
        for (let k = 0; k < pixels.length; k += 4) count += pixels[k] === 0 && pixels[k + 1] === 255 && pixels[k + 2] === 0 ? 1 : 0;
        counts.push(count);
      }
      return counts;
    };
    return {before: await green(-6, 0.6), within: await green(-1.5, 1.8), behind: await green(9, 4)};
  }, madeCameras[0]);
  console.log(`pixels of the mesh alone, without and with splats: ${JSON.stringify(found)}`);
  for (const [alone] of Object.values(found)) assert.ok(alone > 1000, 'the mesh is in the picture');
  assert.equal(found.before[1], found.before[0], 'nothing hides it');
  assert.ok(found.within[1] > 0 && found.within[1] < 0.9 * found.within[0], 'splats hide a part');
  assert.ok(found.behind[1] < 0.1 * found.behind[0], 'splats hide it');
});

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
  assert.deepEqual(page.errors, []);
});
