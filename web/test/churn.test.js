// SPDX-License-Identifier: Apache-2.0
// A page that opens and removes players, many times (L4D_CHURN, 20), as sites of one page do: nothing of them stays.
import assert from 'node:assert/strict';
import {join} from 'node:path';
import {after, before, test} from 'node:test';
import {heap, launch, pageWith, serve, work} from './browser.js';

const count = Number(process.env.L4D_CHURN ?? 20);
let browser, server;
before(async () => {
  browser = await launch();
  server = await serve({'frames.l4d': join(work, 'frames.l4d')});
});
after(async () => {
  await browser?.close();
  server?.close();
});

test(`${count} players that are opened, used and removed leave no memory, no node, no listener and no worker`, () => pageWith(
  browser, server, '', async page => {
    /**
     * What is there once no worker is, and collections find no more. The last player goes when the browser wants: a node
     * that none of its events needs any longer.
     * @param {(now: {nodes: number, listeners: number}) => boolean} [done] whether it is what is to be there: what is not, is waited for
     */
    const settled = async (done = () => true) => {
      await page.evaluate(() => new Promise(resolve => requestAnimationFrame(resolve)));
      for (let last = await heap(page), k = 0; ; ++k) {
        const now = await heap(page);
        const rests = now.nodes >= last.nodes && now.bytes > last.bytes - 1e4;
        if (page.workers().length === 0 && rests && done(now) || k === 300) return now;
        last = now;
        if (rests) await new Promise(resolve => setTimeout(resolve, 20));
      }
    };
    const use = (/** @type {number} */ times) => page.evaluate(async times => {
      for (let k = 0; k < times; ++k) {
        document.body.innerHTML = `<l4d-player src="frames.l4d" auto-rotate lang="fr"><track kind="captions" srclang="en" default src="data:text/vtt,WEBVTT">
          <track kind="metadata" label="thumbnails" src="data:text/vtt,WEBVTT">
          <button slot="hotspot-middle" data-position="0 0 0">Middle</button></l4d-player>`;
        const player = document.querySelector('l4d-player');
        await player.play();
        player.toggleMenu(true);
        player.preview.show(0.5);
        player.toggleOverlay(true);
        await player.movie.slice(0.5);
        await player.requestPictureInPicture().catch(() => {});  // there is one gesture
        player.remove();
        await null;
      }
      document.body.innerHTML = '';
    }, times);
    await use(Math.ceil(count / 4));
    const first = await settled();
    await use(count - Math.ceil(count / 4));
    const isGone = (/** @type {Record<string, number>} */ now) => now.nodes - first.nodes < 50 && now.listeners - first.listeners < 20;
    const last = await settled(isGone);
    const grown = (/** @type {string} */ name) => last[name] - first[name];
    console.log(`from ${first.bytes} to ${last.bytes} bytes`);
    assert.equal(page.workers().length, 0);
    assert.ok(isGone(last), `${grown('nodes')} nodes, ${grown('listeners')} listeners`);
    assert.ok(grown('bytes') < 3e5, `from ${first.bytes} to ${last.bytes} bytes`);
  }));
