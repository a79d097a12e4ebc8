// SPDX-License-Identifier: Apache-2.0
// usage: node screenshots.js SCENE.l4d FOLDER [EYE TARGET [NAME]], each x,y,z: pictures of the player for docs.
import {join} from 'node:path';
import {launch, newPage, opened, serve} from './browser.js';

const [scene, folder, eye, target] = process.argv.slice(2);
const server = await serve({'scene.l4d': scene});
const browser = await launch();
const only = process.argv[6];
const sizes = [
  {name: 'desktop', viewport: {width: 1120, height: 630}, overlay: true},
  {name: 'menu', viewport: {width: 1120, height: 630}, menu: true},
  {name: 'phone', viewport: {width: 390, height: 780}, hasTouch: true, isMobile: true},
  {name: 'start', viewport: {width: 960, height: 540}, reducedMotion: 'reduce'}
];
for (const {name, overlay, menu, ...options} of sizes.filter(s => !only || s.name === only)) {
  const page = await newPage(browser, options);
  await page.goto(server.url);
  await opened(page);
  await page.evaluate(async ({eye, target, overlay, menu, still}) => {
    const player = document.querySelector('l4d-player');
    if (!still) player.movie.pause();
    if (eye) player.view.orbit.lookAt(eye, target);
    await player.movie.seek(2.4);
    player.toggleOverlay(overlay === true);
    if (menu) player.toggleMenu(true);
    if (still) player.shadowRoot.querySelector('.big').hidden = false;
    player.view.change();
    await player.view.settled();
  }, {eye: eye?.split(',').map(Number), target: target?.split(',').map(Number), overlay, menu,
      still: options.reducedMotion === 'reduce'});
  await page.waitForTimeout(700);
  await page.screenshot({path: join(folder, `player-${name}.jpg`), type: 'jpeg', quality: 82, timeout: 300000});
  console.log(name, page.errors);
  await page.close();
}
await browser.close();
server.close();
