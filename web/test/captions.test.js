// SPDX-License-Identifier: Apache-2.0
// Children <track> of <l4d-player>: captions, and thumbnails of the timeline.
import assert from 'node:assert/strict';
import {mkdtempSync, rmSync, writeFileSync} from 'node:fs';
import {tmpdir} from 'node:os';
import {join} from 'node:path';
import {after, before, test} from 'node:test';
import {launch, opened, pageWith, serve, touch, work} from './browser.js';

const folder = mkdtempSync(join(tmpdir(), 'l4dcaptions-'));
const texts = {
  'en.vtt': 'WEBVTT\n\n00:01.000 --> 00:02.000\nThe <i>first</i> line\nand a second\n\n00:01.500 --> 00:03.000\nAnother <script>cue</script>\n',
  'de.vtt': 'WEBVTT\n\n00:01.000 --> 00:03.000\nDie erste Zeile\n',
  'thumbs.vtt': `WEBVTT\n\n${[0, 1, 2, 3].map(k => `00:0${k}.000 --> 00:0${k + 1}.000\nsprite.svg#xywh=${160 * k},0,160,90\n`).join('\n')}`,
  'sprite.svg': `<svg xmlns="http://www.w3.org/2000/svg" width="640" height="90">${['teal', 'navy', 'maroon', 'olive'].map((color, k) =>
    `<rect x="${160 * k}" width="160" height="90" fill="${color}"/><circle cx="${160 * k + 80}" cy="45" r="${10 + 10 * k}" fill="white"/>`).join('')}</svg>`
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
/** For screenshots that are looked at: L4D_SHOTS names a folder. @param {any} page @param {string} name */
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

const withThumbnails = '<l4d-player src="short.l4d"><track kind="metadata" label="thumbnails" src="thumbs.vtt"></l4d-player>';
/** The colour in the middle of the thumbnail, the corners of its bubble, and its time. @param {any} page */
const thumbnail = page => page.evaluate(async () => {
  const {shadowRoot: root} = document.querySelector('l4d-player');
  const [bubble, box, image] = ['.hover', '.thumb', '.thumb img'].map(selector => root.querySelector(selector));
  if (getComputedStyle(bubble).visibility === 'hidden') return null;
  await until(() => !box.hidden && image.complete, 'a thumbnail');
  const [seen, whole] = [box.getBoundingClientRect(), image.getBoundingClientRect()];
  const {left, right} = bubble.getBoundingClientRect();
  return {cell: Math.round(100 * (seen.left - whole.left) / seen.width) / 100, size: [seen.width, seen.height], inside: left >= 0 && right <= innerWidth, time: bubble.textContent};
});

test('thumbnails of the timeline: under the pointer, within the player, and fetched for who points there', () => withPage(withThumbnails, async page => {
  assert.ok(!server.names.includes('thumbs.vtt'));
  const {x, y, width, height} = await page.locator('.track input').boundingBox();
  const at = async (/** @type {number} */ share) => {
    await page.mouse.move(x + share * width, y + height / 2);
    return thumbnail(page);
  };
  assert.deepEqual(await at(0.4), {cell: 1, size: [160, 90], inside: true, time: '0:01.6'});
  await shot(page, 'thumbnails');
  assert.deepEqual(await at(0.002), {cell: 0, size: [160, 90], inside: true, time: '0:00.0'});
  assert.deepEqual(await at(0.998), {cell: 3, size: [160, 90], inside: true, time: '0:04.0'});
  await page.mouse.move(x, y - 60);
  assert.equal(await thumbnail(page), null);
}));

test('thumbnails are there while a finger drags, and gone behind it', () => withPage(withThumbnails, async page => {
  const {x, y, width, height} = await page.locator('.track input').boundingBox();
  const finger = await touch(page);
  const at = (/** @type {number} */ share) => [[x + share * width, y + height / 2]];
  await finger.start(at(0.2));
  await finger.move(at(0.5));
  await finger.move(at(0.6));
  const {cell, size, inside} = await thumbnail(page);
  await shot(page, 'thumbnails-touch');
  assert.deepEqual([cell, inside, Math.round(size[0])], [2, true, Math.round(0.4 * 304)]);
  await finger.end();
  await page.waitForFunction(() => !document.querySelector('l4d-player').scrubbing);
  assert.equal(await thumbnail(page), null);
}, {size: [320, 220], options: {hasTouch: true}}));
