// SPDX-License-Identifier: Apache-2.0
// Captions of <l4d-player>: children <track>.
import assert from 'node:assert/strict';
import {mkdtempSync, rmSync, writeFileSync} from 'node:fs';
import {tmpdir} from 'node:os';
import {join} from 'node:path';
import {after, before, test} from 'node:test';
import {launch, opened, pageWith, serve, work} from './browser.js';

const folder = mkdtempSync(join(tmpdir(), 'l4dcaptions-'));
const texts = {
  'en.vtt': 'WEBVTT\n\n00:01.000 --> 00:02.000\nThe <i>first</i> line\nand a second\n\n00:01.500 --> 00:03.000\nAnother <script>cue</script>\n',
  'de.vtt': 'WEBVTT\n\n00:01.000 --> 00:03.000\nDie erste Zeile\n'
};
let browser, server;
before(async () => {
  for (const [name, text] of Object.entries(texts)) writeFileSync(join(folder, name), text);
  browser = await launch();
  server = await serve({'short.l4d': join(work, 'short.l4d'), ...Object.fromEntries(Object.keys(texts).map(name => [name, join(folder, name)]))});
});
after(async () => {
  await browser?.close();
  server?.close();
  rmSync(folder, {recursive: true});
});

const body = `<l4d-player src="short.l4d">
  <track kind="captions" src="en.vtt" srclang="en" label="English (for all)" default><track kind="subtitles" src="de.vtt" srclang="de">
  <track kind="chapters" src="missing.vtt"></l4d-player>`;

/** @param {string} body @param {(page: any) => Promise<void>} fn @param {any} [options] */
const withPage = (body, fn, options) => pageWith(browser, server, body, async page => {
  await opened(page);
  await fn(page);
}, options);
/** What is shown at a time. @param {any} page @param {number} time */
const shownAt = (page, time) => page.evaluate(async time => {
  const player = document.querySelector('l4d-player');
  await until(() => [...player.textTracks].every(track => track.mode !== 'showing' || track.cues?.length), 'cues');
  await player.movie.seek(time);
  return [...player.shadowRoot.querySelectorAll('.captions p')].map(line => line.innerHTML);
}, time);
const shot = (page, name) => process.env.L4D_SHOTS ? page.screenshot({path: join(process.env.L4D_SHOTS, `${name}.png`)}) : undefined;

test('the cues of a track are shown in their time, as text', () => withPage(body, async page => {
  assert.deepEqual(await shownAt(page, 0.5), []);
  assert.deepEqual(await shownAt(page, 1.2), ['The <i>first</i> line\nand a second']);
  await shot(page, 'captions');
  assert.deepEqual(await shownAt(page, 1.7), ['The <i>first</i> line\nand a second', 'Another cue']);
  assert.deepEqual(await shownAt(page, 2), ['Another cue']);
  await page.evaluate(() => document.querySelector('l4d-player').unload());
  assert.equal(await page.evaluate(() => document.querySelector('l4d-player').shadowRoot.querySelector('.captions').childElementCount), 0);
}));

test('the button, the menu and the key C choose what is shown', () => withPage(body, async page => {
  const modes = () => page.evaluate(() => [...document.querySelector('l4d-player').textTracks].map(track => track.mode));
  const button = page.getByRole('button', {name: 'Captions'});
  assert.deepEqual([await modes(), await button.getAttribute('aria-pressed')], [['showing', 'disabled', 'disabled'], 'true']);
  await button.click();
  assert.deepEqual([await modes(), await button.getAttribute('aria-pressed')], [['disabled', 'disabled', 'disabled'], 'false']);
  assert.deepEqual(await shownAt(page, 1.2), []);
  await page.click('.settings');
  assert.deepEqual(await page.getByLabel('Captions', {exact: true}).locator('option').allTextContents(), ['Off', 'English (for all)', 'German']);
  await page.locator('#captions').selectOption('German');
  assert.deepEqual(await shownAt(page, 1.2), ['Die erste Zeile']);
  await page.keyboard.press('Escape');
  await page.locator('canvas').focus();
  await page.keyboard.press('c');
  assert.deepEqual(await modes(), ['disabled', 'disabled', 'disabled']);
  await page.keyboard.press('c');
  assert.deepEqual(await modes(), ['disabled', 'showing', 'disabled']);
}));

test('scripts have text tracks as of media elements; children come, change and go', () => withPage('<l4d-player src="short.l4d"></l4d-player>', async page => {
  const found = await page.evaluate(async () => {
    const player = document.querySelector('l4d-player');
    const button = player.shadowRoot.querySelector('.cc');
    const states = [button.hidden, player.textTracks.length];
    const child = Object.assign(document.createElement('track'), {kind: 'subtitles', src: 'missing.vtt', srclang: 'not a tag'});
    const failed = new Promise(resolve => child.addEventListener('error', resolve, {once: true}));
    player.append(child);
    await null;
    player.textTracks[0].mode = 'showing';
    await failed;
    states.push(button.hidden, player.shadowRoot.querySelector('#captions').options[1].text);
    const loaded = new Promise(resolve => child.addEventListener('load', resolve, {once: true}));
    Object.assign(child, {src: 'de.vtt', default: true});
    await loaded;
    states.push(player.textTracks[0].cues.length);
    child.remove();
    await null;
    states.push(player.textTracks.length, button.hidden);
    const track = player.addTextTrack('captions', 'Made', 'en');
    track.addCue(new VTTCue(0, 4, 'made'));
    track.mode = 'showing';
    await until(() => !button.hidden, 'the button');
    return states;
  });
  assert.deepEqual(found, [true, 0, false, 'not a tag', 1, 0, true]);
  assert.deepEqual(await shownAt(page, 2), ['made']);
}, {errors: /404/}));
