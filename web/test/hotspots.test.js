// SPDX-License-Identifier: Apache-2.0
// Hotspots of <l4d-player>: children of it that stay where they are in the scene.
import assert from 'node:assert/strict';
import {test} from 'node:test';
import {opened} from './browser.js';
import {pagesWith} from './pages.js';

const withPage = pagesWith('short');

const body = `<l4d-player src="short.l4d" camera-orbit="0 85deg 8" camera-target="0 0 0">
  <button slot="hotspot-middle" data-position="0 0 0">Middle</button>
  <button slot="hotspot-early" data-position="2 0 0" data-end="2">Early</button>
  <button slot="hotspot-late" data-position="0 1 0" data-begin="2">Late</button>
  <button slot="hotspot-none" data-position="here">Nowhere</button></l4d-player>`;

/** Middles and names of those that are seen. @param {any} page */
const shown = page => page.evaluate(async () => {
  const player = document.querySelector('l4d-player');
  await player.view.settled();
  const buttons = [...player.querySelectorAll('button')].filter(button => button.checkVisibility());
  return Object.fromEntries(buttons.map(button => {
    const box = button.getBoundingClientRect();
    return [button.textContent, [box.left + box.width / 2, box.top + box.height / 2]];
  }));
});

test('hotspots are where their positions are, in their time, and take the focus', () => withPage(body, async page => {
  await opened(page);
  const middle = await page.evaluate(() => {
    globalThis.player = document.querySelector('l4d-player');
    globalThis.clicks = [];
    player.addEventListener('click', ({target}) => globalThis.clicks.push(target.textContent));
    const box = player.getBoundingClientRect();
    return [box.left + box.width / 2, box.top + box.height / 2];
  });
  const first = await shown(page);
  assert.deepEqual(Object.keys(first), ['Middle', 'Early']);
  assert.ok(Math.hypot(first.Middle[0] - middle[0], first.Middle[1] - middle[1]) < 1.5, `${first.Middle}, not ${middle}`);
  // Two units to the side, eight away.
  const {focal, right} = await page.evaluate(() => {
    const {view} = player;
    return {focal: view.camera().fx * view.canvas.clientWidth / view.canvas.width, right: view.orbit.axes()[0]};
  });
  assert.ok(Math.abs(Math.abs(right[0]) - 1) < 1e-6, `${right}`);
  assert.ok(Math.abs(first.Early[0] - middle[0] - Math.sign(right[0]) * focal / 4) < 2, `${first.Early}, ${middle}, ${focal}`);
  // They move with the camera, and are gone where it does not see them.
  await page.evaluate(() => {
    player.view.orbit.orbit(0.5, 0);
    player.view.change();
  });
  const turned = await shown(page);
  assert.ok(Math.abs(turned.Early[0] - first.Early[0]) > 2 && Math.abs(turned.Middle[0] - middle[0]) < 1.5, JSON.stringify(turned));
  await page.evaluate(() => {
    player.view.orbit.lookAt([3, 0, 0], [9, 0, 0]);
    player.view.change();
  });
  assert.deepEqual(await shown(page), {});
  await page.evaluate(() => player.home());
  assert.deepEqual(Object.keys(await shown(page)), ['Middle', 'Early']);
  // The keyboard reaches those that are shown; the space bar is theirs.
  await page.evaluate(() => player.shadowRoot.querySelector('canvas').focus());
  await page.keyboard.press('Tab');
  assert.equal(await page.evaluate(() => document.activeElement.textContent), 'Middle');
  await page.keyboard.press(' ');
  await page.keyboard.press('Tab');
  await page.keyboard.press('Enter');
  await page.getByRole('button', {name: 'Early'}).click();
  assert.deepEqual(await page.evaluate(() => [globalThis.clicks, player.paused]), [['Middle', 'Early', 'Early'], true]);
  assert.equal(await page.getByRole('button', {name: 'Late'}).count(), 0);
  // Whose time is over gives the focus to the picture.
  await page.evaluate(async () => {
    player.querySelector('[slot=hotspot-early]').focus();
    await player.movie.seek(2);
  });
  assert.deepEqual(Object.keys(await shown(page)), ['Middle', 'Late']);
  assert.equal(await page.evaluate(() => player.shadowRoot.activeElement?.tagName), 'CANVAS');
  // Those that come later count, too, and others go.
  await page.evaluate(() => {
    player.querySelector('[slot=hotspot-none]').dataset.position = '0 0 1';
    player.querySelector('[slot=hotspot-late]').remove();
    player.insertAdjacentHTML('beforeend', '<button slot="hotspot-new" data-position="0 -1 0">New</button>');
  });
  assert.deepEqual(Object.keys(await shown(page)), ['Middle', 'Nowhere', 'New']);
  assert.equal(await page.evaluate(() => player.shadowRoot.querySelectorAll('.spots slot').length), 4);
  await page.evaluate(() => player.unload());
  assert.equal(await page.evaluate(() => [...player.querySelectorAll('button')].filter(b => b.checkVisibility()).length), 0);
}));
