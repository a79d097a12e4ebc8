// SPDX-License-Identifier: Apache-2.0
// Picture in picture of <l4d-player>.
import assert from 'node:assert/strict';
import {test} from 'node:test';
import {opened} from './browser.js';
import {pagesWith} from './pages.js';

const withPage = pagesWith('short');

const body = '<l4d-player src="short.l4d"></l4d-player>';
/** Also collects events, and what the window shows. @param {any} page */
const prepare = page => page.evaluate(() => {
  globalThis.player = document.querySelector('l4d-player');
  globalThis.seen = [];
  for (const type of ['enterpictureinpicture', 'leavepictureinpicture']) {
    player.addEventListener(type, event => seen.push([type, event.pictureInPictureWindow.width > 0]));
  }
});

test('the button of the menu opens a window with the picture, which goes with the player', () => withPage(body, async page => {
  await opened(page);
  await prepare(page);
  await page.click('.settings');
  await page.getByRole('button', {name: 'Picture in picture'}).click();
  await page.waitForFunction(() => seen.length === 1);
  const found = await page.evaluate(async () => {
    const {video} = player.pip;
    const [track] = video.srcObject.getTracks();
    const size = [video.videoWidth, video.videoHeight];
    const {width, height} = player.view.canvas;
    // What is drawn from now on is there, too.
    const next = new Promise(resolve => video.requestVideoFrameCallback(resolve));
    await player.movie.seek(2);
    await next;
    const painter = Object.assign(document.createElement('canvas'), {width, height}).getContext('2d');
    painter.drawImage(video, 0, 0);
    const light = painter.getImageData(0, 0, width, height).data.reduce((sum, v, k) => sum + (k % 4 === 3 ? 0 : v), 0) / (3 * width * height);
    player.remove();
    await until(() => seen.length === 2, 'the window to close');
    return {size, canvas: [width, height], light, seen, state: track.readyState};
  });
  assert.deepEqual(found.size, found.canvas);
  assert.ok(found.light > 5, `${found.light}`);
  assert.deepEqual([found.seen, found.state], [[['enterpictureinpicture', true], ['leavepictureinpicture', false]], 'ended']);
}));

test('pages leave it as that of a video, and hear why there is none', () => withPage(body, async page => {
  await opened(page);
  await prepare(page);
  const name = () => page.evaluate(() => player.requestPictureInPicture().then(() => 'done', error => error.name));
  assert.equal(await name(), 'done');
  await page.evaluate(() => document.exitPictureInPicture());
  await page.waitForFunction(() => seen.length === 2 && !player.pip.video);
  await page.evaluate(() => {
    HTMLVideoElement.prototype.requestPictureInPicture = () => Promise.reject(new DOMException('no gesture', 'NotAllowedError'));
  });
  assert.equal(await name(), 'NotAllowedError');
  assert.equal(await page.evaluate(() => player.pip.video), null);
  await page.evaluate(() => player.unload());
  assert.equal(await name(), 'InvalidStateError');
}));

test('a browser without it has no button', () => withPage('', async page => {
  const [hidden, name] = await page.evaluate(async () => {
    Object.defineProperty(document, 'pictureInPictureEnabled', {value: false});
    const player = document.createElement('l4d-player');
    return [player.shadowRoot.querySelector('.pip').hidden, await player.requestPictureInPicture().catch(error => error.name)];
  });
  assert.deepEqual([hidden, name], [true, 'NotSupportedError']);
}));
