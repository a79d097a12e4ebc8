// SPDX-License-Identifier: Apache-2.0
// The gallery that web/site/build.sh makes, as any static server sends it, on a desktop and on a phone.
import assert from 'node:assert/strict';
import {execFileSync} from 'node:child_process';
import {join, relative} from 'node:path';
import {after, before, test} from 'node:test';
import {launch, newPage, serve, work} from './browser.js';

let browser, server;
before(async () => {
  const root = process.env.L4D_ROOT, site = join(work, 'site');
  execFileSync('bash', [join(root, 'web/site/build.sh'), process.env.L4D_TOOL, join(root, 'build/web/player'), site, '2000']);
  browser = await launch();
  server = await serve({'square.l4d': join(site, 'square.l4d'), 'room.l4d': join(site, 'room.l4d')}, {}, relative(root, site));
});
after(async () => {
  await browser?.close();
  server?.close();
});

for (const [name, width, height] of [['a desktop', 1280, 800], ['a phone', 390, 844]]) {
  test(`the gallery on ${name}: all scenes open, and nothing is wider than the page`, async () => {
    const page = await newPage(browser, {viewport: {width, height}});
    try {
      await page.goto(server.url);
      for (const scene of ['square', 'room']) {
        await page.locator(`l4d-player[src^=${scene}]`).scrollIntoViewIfNeeded();
        await page.waitForFunction(src => document.querySelector(`l4d-player[src^=${src}]`).isOpen, scene, {timeout: 120000});
      }
      assert.equal(await page.evaluate(() => document.documentElement.scrollWidth), width);
      assert.match(await page.textContent('article'), /[0-9.]+ MB, 8 s, 2 thousand Gaussians/);
      assert.deepEqual(page.errors, []);
    } finally {
      await page.close();
    }
  });
}
