// SPDX-License-Identifier: Apache-2.0
// The language of <l4d-player>: that of the page, or of the reader; words of the page.
import assert from 'node:assert/strict';
import {test} from 'node:test';
import {opened} from './browser.js';
import {pagesWith} from './pages.js';

const withPage = pagesWith('short');

/** What players say. @param {any} page */
const said = page => page.evaluate(() => [...document.querySelectorAll('l4d-player')].map(player => {
  const {shadowRoot: root} = player;
  return [root.querySelector('.settings').title, root.querySelector('label[for=loop]').textContent];
}));
const player = '<l4d-player src="short.l4d"></l4d-player>';

test('the closest lang decides, else what the reader wants, else English', () => withPage(
  `<l4d-player></l4d-player><div lang="fr-CA"><l4d-player></l4d-player><l4d-player lang="ja"></l4d-player></div>
  <l4d-player lang="xx"></l4d-player><l4d-player lang=""></l4d-player>`, async page => {
    assert.deepEqual(await said(page), [['Ajustes', 'Repetir'], ['Réglages', 'Boucle'], ['設定', 'ループ'], ['Settings', 'Loop'], ['Ajustes', 'Repetir']]);
    await page.evaluate(() => {
      document.querySelector('div').lang = 'de';
      document.querySelector('[lang=ja]').lang = 'zh-Hans-CN';
    });
    assert.deepEqual((await said(page)).slice(1, 3), [['Einstellungen', 'Wiederholen'], ['设置', '循环']]);
    await page.evaluate(() => document.documentElement.setAttribute('lang', 'en'));
    assert.deepEqual((await said(page))[0], ['Settings', 'Loop']);
  }, {options: {locale: 'es-MX'}}));

test('pages add words and languages, and players say them at once; a player in a shadow follows its host', () => withPage(
  '<l4d-player lang="pl"></l4d-player><div lang="de"></div>', async page => {
    await page.evaluate(async () => {
      const {L4DPlayer} = await import('/player.js');
      const root = document.querySelector('div').attachShadow({mode: 'open'});
      root.append(globalThis.inner = new L4DPlayer());
      L4DPlayer.words = {pl: {settings: 'Ustawienia'}, de: {loop: 'Nochmal'}};
    });
    const inner = () => page.evaluate(() => ['label[for=loop]', 'label[for=mode]'].map(s => globalThis.inner.shadowRoot.querySelector(s).textContent));
    assert.deepEqual([await said(page), await inner()], [[['Ustawienia', 'Loop']], ['Nochmal', 'Kamera']]);
    await page.evaluate(() => { document.querySelector('div').lang = 'fr'; });
    assert.deepEqual(await inner(), ['Boucle', 'Caméra']);
  }));

test('what is shown and spoken changes its language, too', () => withPage(player, async page => {
  await opened(page);
  const found = await page.evaluate(async () => {
    const player = document.querySelector('l4d-player');
    const {shadowRoot: root} = player;
    player.toggleOverlay(true);
    player.movie.pause();
    const of = () => [root.querySelector('.play').title, root.querySelector('.track input').getAttribute('aria-valuetext'),
                      root.querySelector('#level').options[0].text, root.querySelector('.overlay dt').textContent, root.querySelector('.bar').lang];
    const before = of();
    player.lang = 'de';
    await null;
    const after = of();
    await player.load('missing.l4d').catch(() => {});
    const title = root.querySelector('.message b');
    const errors = [title.textContent];
    player.lang = 'zh';
    await null;
    return {before, after, errors: [...errors, title.textContent]};
  });
  assert.deepEqual(found, {
    before: ['Play (space)', '0 seconds of 4 seconds', 'All', 'frames', 'en'],
    after: ['Abspielen (Leertaste)', '0 Sekunden von 4 Sekunden', 'Alle', 'Bilder', 'de'],
    errors: ['Der Server hat diese Datei nicht', '服务器上没有此文件']
  });
}, {errors: /404/}));
