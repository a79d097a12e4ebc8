// SPDX-License-Identifier: Apache-2.0
// The gallery that web/site/build.sh makes, as any static server sends it, on a desktop and on a phone.
import assert from 'node:assert/strict';
import {execFileSync} from 'node:child_process';
import {existsSync, mkdirSync, readdirSync, readFileSync, rmSync} from 'node:fs';
import {join, relative} from 'node:path';
import {after, before, test} from 'node:test';
import {complaints, launch, newPage, serve, swipe, work} from './browser.js';

const root = process.env.L4D_ROOT, tool = process.env.L4D_TOOL, site = join(work, 'site'), data = join(work, 'site-data');
const build = (folder, from) => execFileSync(
    join(root, 'web/site/build.sh'), [tool, join(root, 'build/web/player'), folder, '2000'],
    {env: {...process.env, L4D_DATA_DIR: from}, encoding: 'utf8'});
const scenes = ['square', 'room', 'angel', 'trumpet'];
let browser, server, said;
before(async () => {
  // In place of statues: small scenes that stand still, so that the test needs no data.
  mkdirSync(join(data, 'statues'), {recursive: true});
  execFileSync(tool, ['synth', '--scene', 'cloud', '--seconds', '1', '-n', '2000', '-q', '-f', '-o', join(data, 'cloud.ply')]);
  for (const [name, time] of [['angel', '0'], ['trumpet', '0.5']]) {
    execFileSync(tool, ['slice', join(data, 'cloud.ply'), '--time', time, '-q', '-f', '-o', join(data, `statues/${name}.ply`)]);
  }
  rmSync(site, {recursive: true, force: true});
  said = build(site, data);
  browser = await launch();
  // Trained scenes come with the others where they have been made.
  const streams = readdirSync(site).filter(name => name.endsWith('.l4d'));
  server = await serve(Object.fromEntries(streams.map(name => [name, join(site, name)])), {}, relative(root, site));
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
      for (const scene of scenes) {
        await page.locator(`l4d-player[src^=${scene}]`).scrollIntoViewIfNeeded();
        await page.waitForFunction(src => document.querySelector(`l4d-player[src^=${src}]`).isOpen, scene, {timeout: 120000});
      }
      assert.equal(await page.evaluate(() => document.documentElement.scrollWidth), width);
      assert.match(await page.textContent('article'), /[0-9.]+ MB, 8 s, 2 thousand Gaussians/);
      assert.deepEqual(await complaints(page), []);
    } finally {
      await page.close();
    }
  });
}

test('on a phone one finger turns the scene or scrolls the page, and two fingers come nearer', async () => {
  const page = await newPage(browser, {viewport: {width: 390, height: 844}, hasTouch: true, isMobile: true, reducedMotion: 'reduce'});
  try {
    await page.goto(server.url);
    await page.waitForFunction(() => document.querySelector('l4d-player').isOpen, undefined, {timeout: 120000});
    const {x, y} = await page.evaluate(() => {
      const player = document.querySelector('l4d-player'), box = player.getBoundingClientRect();
      globalThis.before = player.getCameraOrbit();
      return {x: box.x + box.width / 2, y: box.y + box.height / 4};  // above the button in the middle
    });
    await swipe(page, [[[x - 60, y], [x + 60, y]]]);
    await page.waitForFunction(() => Math.abs(document.querySelector('l4d-player').getCameraOrbit().theta - globalThis.before.theta) > 0.2);
    assert.equal(await page.evaluate(() => scrollY), 0);
    await swipe(page, [[[x - 20, y], [x - 80, y + 20]], [[x + 20, y], [x + 80, y - 20]]]);
    await page.waitForFunction(() => document.querySelector('l4d-player').getCameraOrbit().radius < globalThis.before.radius * 0.7);
    assert.deepEqual(await page.evaluate(() => [scrollY, visualViewport.scale]), [0, 1]);
    await swipe(page, [[[x, y + 60], [x, y - 60]]]);
    await page.waitForFunction(() => scrollY > 40);
    assert.deepEqual(await complaints(page), []);
  } finally {
    await page.close();
  }
});

test('cards of statues state licence and origin, and the text of the licence is beside the streams', async () => {
  const page = await newPage(browser);
  try {
    await page.goto(server.url);
    for (const name of ['angel', 'trumpet']) {
      const card = page.locator('article', {has: page.locator(`l4d-player[src^=${name}]`)});
      assert.match(await card.textContent(), / MB, stands still, \d thousand Gaussians\. Licence: MIT, of the examples of\s+playcanvas/);
      const licence = await page.request.get(new URL(await card.locator('a').first().getAttribute('href'), server.url).href);
      assert.match(await licence.text(), new RegExp(`${name}\\.l4d.*[^]*Permission is hereby granted`));
      assert.match(await card.locator('code').textContent(), new RegExp(`^<l4d-player src="${name}\\.l4d" .*></l4d-player>$`));
    }
    assert.doesNotMatch(said, /left out/);
  } finally {
    await page.close();
  }
});

test('without statues the gallery is made, and says that they are left out', () => {
  const folder = join(work, 'site-without');
  rmSync(folder, {recursive: true, force: true});
  assert.match(build(folder, join(work, 'no-data')), /^the statues are left out: no .*no-data\/statues/m);
  assert.doesNotMatch(readFileSync(join(folder, 'index.html'), 'utf8'), /angel|statue/);
  assert.ok(existsSync(join(folder, 'square.l4d')) && !existsSync(join(folder, 'statues-licence.txt')));
});
