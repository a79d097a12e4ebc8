// SPDX-License-Identifier: Apache-2.0
// Each picture of a movie that plays is the whole picture of one instant: late, where sorting takes long, but not empty, and
// not of two instants.
import assert from 'node:assert/strict';
import {join} from 'node:path';
import {after, before, test} from 'node:test';
import {blankPage, launch, serve, work} from './browser.js';

let browser;
before(async () => { browser = await launch(); });
after(async () => browser?.close());

/**
 * Runs in the page. Plays a stream in a loop, reads each picture, and then compares it with what is shown while the movie
 * rests at the time of that picture.
 * @param {{stream: string, seconds: number, sortMs: number, maxRows?: number}} options sortMs: that orders come later
 */
const playAndCompare = async ({stream, seconds, sortMs, maxRows}) => {
  const {open, View} = await import(/** @type {any} */ ('/player.js'));
  const canvas = Object.assign(document.createElement('canvas'), {width: 160, height: 120});
  Object.assign(canvas.style, {width: '160px', height: '120px'});
  document.body.append(canvas);
  const movie = await open(stream, {maxRows});
  const view = new View(canvas);
  await view.show(movie);
  await movie.seek(0);
  await view.home();
  await view.settled();
  movie.loop = true;

  const {painter, gl, sorter} = view;
  const receive = sorter.onmessage;
  sorter.onmessage = event => setTimeout(() => receive(event), sortMs);
  const draw = painter.draw.bind(painter);
  const seen = [];
  painter.draw = (camera, streams, ...given) => {
    draw(camera, streams, ...given);
    const {width, height} = canvas;
    const bytes = new Uint8Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    seen.push({time: streams[0].time, bytes});
  };
  let played = 0, last = movie.currentTime;
  movie.on('time', time => {
    played += time >= last ? time - last : time - last + movie.duration;
    last = time;
  });
  movie.play();
  for (const end = performance.now() + 60000; played < seconds && performance.now() < end;) {
    await new Promise(resolve => setTimeout(resolve, 25));
  }
  movie.pause();
  painter.draw = draw;
  sorter.onmessage = receive;

  const pictures = [];
  for (const {time, bytes} of seen) {
    await movie.seek(time);
    const still = await view.pixels();  // from the top
    const stride = 4 * canvas.width;
    let difference = 0, light = 0;
    for (let k = 0; k < still.length; ++k) {
      if (k % 4 === 3) continue;
      const y = canvas.height - 1 - Math.floor(k / stride);
      difference += Math.abs(still[k] - bytes[y * stride + k % stride]);
      light += still[k];
    }
    pictures.push({time, difference: difference / light});
  }
  movie.dispose();
  view.dispose();
  return {pictures, played};
};

/** @param {string} name @param {Omit<Parameters<typeof playAndCompare>[0], 'stream'>} options */
const isWhole = async (name, options) => {
  const server = await serve({[`${name}.l4d`]: join(work, `${name}.l4d`)});
  const page = await blankPage(browser, server.url);
  try {
    const {pictures, played} = await page.evaluate(playAndCompare, {stream: `/${name}.l4d`, ...options});
    assert.ok(played >= options.seconds, `played ${played} s`);
    assert.ok(new Set(pictures.map(p => p.time)).size >= 6, `${pictures.length} pictures`);
    const mixed = pictures.filter(p => !(p.difference < 0.005));
    const words = mixed.slice(0, 8).map(p => `${p.time.toFixed(3)} s: ${(100 * p.difference).toFixed(1)} %`);
    assert.equal(mixed.length, 0, `${mixed.length} of ${pictures.length} pictures differ: ${words.join(', ')}`);
    assert.deepEqual(page.errors, []);
  } finally {
    await page.close();
    server.close();
  }
};

test('a short scene in a loop: each picture is whole', () => isWhole('brief', {seconds: 1.5, sortMs: 0}));

test('a short scene in a loop, where sorting takes long: each picture is whole', () =>
  isWhole('brief', {seconds: 1.5, sortMs: 150}));

test('several buckets in a loop, where sorting takes long: each picture is whole', () =>
  isWhole('short', {seconds: 4.5, sortMs: 150}));
