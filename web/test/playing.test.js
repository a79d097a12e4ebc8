// SPDX-License-Identifier: Apache-2.0
// Each picture of a movie that plays is the whole picture of one instant: late, where sorting takes long, but not empty, and
// not of two instants.
import assert from 'node:assert/strict';
import {join} from 'node:path';
import {after, before, test} from 'node:test';
import {blankPage, complaints, launch, serve, work} from './browser.js';

let browser;
before(async () => { browser = await launch(); });
after(async () => browser?.close());

/**
 * Runs in the page. Plays a stream in a loop, reads each picture, and then compares it with what is shown while the movie
 * rests at the time of that picture.
 * @param {{stream: string, from?: number, jump?: number, seconds: number, sortMs: number, rowMs?: number, maxRows?: number}} options
 *   jump: sought once the pictures of `from` are there, sortMs: that orders come later, rowMs: that each bucket takes
 */
const playAndCompare = async ({stream, from = 0, jump, seconds, sortMs, rowMs = 0, maxRows}) => {
  const {open, View} = await import(/** @type {any} */ ('/player.js'));
  const canvas = Object.assign(document.createElement('canvas'), {width: 160, height: 120});
  Object.assign(canvas.style, {width: '160px', height: '120px'});
  document.body.append(canvas);
  const movie = await open(stream, {maxRows});
  const view = new View(canvas);
  let removed = 0, lost = 0;
  canvas.addEventListener('webglcontextlost', () => { ++lost; });
  await view.show(movie);
  view.orbit.frame({middle: [0, 0, 0], radius: 2}, 0);
  await movie.seek(from);
  await view.settled();
  movie.loop = true;
  movie.on('removed', () => { ++removed; });

  const {painter, gl, sorter} = view;
  const receive = sorter.onmessage;
  sorter.onmessage = event => setTimeout(() => receive(event), sortMs);
  const receiveRows = movie.worker.onmessage;
  let queue = Promise.resolve();
  movie.worker.onmessage = event => {
    if (event.data.type === 'rows') queue = queue.then(() => new Promise(resolve => setTimeout(resolve, rowMs)));
    queue = queue.then(() => receiveRows(event));
  };
  const draw = painter.draw.bind(painter);
  const seen = [];
  painter.draw = (camera, streams, ...given) => {
    draw(camera, streams, ...given);
    const {width, height} = canvas;
    const bytes = new Uint8Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    seen.push({time: streams[0].time, bytes});
  };
  if (jump !== undefined) await movie.seek(jump);
  let played = 0, last = movie.currentTime;
  movie.on('time', time => {
    played += time >= last ? time - last : time - last + movie.duration;
    last = time;
  });
  movie.play();
  // On a slow machine until there is enough to compare.
  const times = () => new Set(seen.map(picture => picture.time)).size;
  for (const end = performance.now() + 60000; (played < seconds || times() < 4) && performance.now() < end;) {
    await new Promise(resolve => setTimeout(resolve, 25));
  }
  movie.pause();
  const removedPlaying = removed;
  painter.draw = draw;
  sorter.onmessage = receive;
  // What still comes meanwhile waits its turn: a bucket that went would else be there, and one that came would not.
  for (let last; last !== queue;) await (last = queue);
  movie.worker.onmessage = receiveRows;

  const pictures = [];
  for (const {time, bytes} of seen) {
    await movie.seek(time);
    if (movie.ready.detail !== 'full') await until(() => movie.ready.detail === 'full', `all of ${time} s`);
    const still = await view.pixels();  // from the top
    const stride = 4 * canvas.width;
    let difference = 0, light = 0;
    for (let k = 0; k < still.length; ++k) {
      if (k % 4 === 3) continue;
      const y = canvas.height - 1 - Math.floor(k / stride);
      difference += Math.abs(still[k] - bytes[y * stride + k % stride]);
      light += still[k];
    }
    const samples = 3 * canvas.width * canvas.height;
    pictures.push({time, light: light / samples, difference: difference / Math.max(light, samples)});
  }
  movie.dispose();
  view.dispose();
  return {pictures, played, removed: removedPlaying, lost};
};

/** @param {string} name @param {Omit<Parameters<typeof playAndCompare>[0], 'stream'>} options */
const isWhole = async (name, options) => {
  const server = await serve({[`${name}.l4d`]: join(work, `${name}.l4d`)});
  const page = await blankPage(browser, server.url);
  try {
    const {pictures, played, removed, lost} = await page.evaluate(playAndCompare, {stream: `/${name}.l4d`, ...options});
    assert.deepEqual(await complaints(page), []);
    assert.equal(lost, 0, 'the context was lost');
    assert.ok(played >= options.seconds, `played ${played} s`);
    const times = new Set(pictures.map(p => p.time)).size, lit = pictures.filter(p => p.light > 1).length;
    assert.ok(times >= 4 && lit > 0, `${pictures.length} pictures of ${times} times, ${lit} of them lit`);
    const mixed = pictures.filter(p => !(p.difference < 0.005));
    const words = mixed.slice(0, 8).map(p => `${p.time.toFixed(3)} s: ${(100 * p.difference).toFixed(1)} %`);
    assert.equal(mixed.length, 0, `${mixed.length} of ${pictures.length} pictures differ: ${words.join(', ')}`);
    assert.equal(removed > 0, options.maxRows !== undefined, `${removed} buckets removed`);
  } finally {
    await page.close();
    server.close();
  }
};

test('a short scene in a loop: each picture is whole', () => isWhole('brief', {seconds: 1.5, sortMs: 0}));

test('a short scene in a loop, where sorting takes long: each picture is whole', () =>
  isWhole('brief', {seconds: 4, sortMs: 100}));

test('several layers of buckets, where sorting takes long: each picture is whole', () =>
  isWhole('layered', {from: 4, seconds: 4, sortMs: 150}));

test('rows that come one by one and make others go: each picture is whole', () =>
  isWhole('layered', {from: 0.2, jump: 6.5, seconds: 1, sortMs: 20, rowMs: 30, maxRows: 20000}));

test('a view of a movie whose instant failed shows what there is, and waits for the next one', async () => {
  const server = await serve({'layered.l4d': join(work, 'layered.l4d')});
  const page = await blankPage(browser, server.url);
  try {
    await page.evaluate(async () => {
      const {open} = await import(/** @type {any} */ ('/player.js'));
      // From the first picture on nothing is found: what comes ahead of it would be there for the next instant.
      let isLost = false;
      const movie = await open('/layered.l4d', {cacheBytes: 1 << 20, request: ({url}) => ({url: isLost ? '/nowhere' : url})});
      await movie.seek(0.2).then(() => { isLost = true; });
      Object.assign(globalThis, {movie});
    });
    const found = await page.evaluate(async () => {
      const {View} = await import(/** @type {any} */ ('/player.js'));
      const {movie} = /** @type {any} */ (globalThis);
      const outcome = await movie.seek(9.6).then(() => 'done', error => error.code);
      const {detail} = movie.ready;
      const canvas = document.body.appendChild(document.createElement('canvas'));
      const view = new View(canvas);
      await view.show(movie);
      const settled = await Promise.race([
        view.settled().then(() => true), new Promise(resolve => setTimeout(() => resolve(false), 60000))]);
      const failed = movie.hasFailed;
      movie.seek(3).catch(() => {});
      const next = movie.hasFailed;
      movie.dispose();
      view.dispose();
      return {outcome, detail, settled, failed, next};
    });
    assert.notEqual(found.outcome, 'done');
    assert.deepEqual({...found, outcome: ''}, {outcome: '', detail: 'none', settled: true, failed: true, next: false});
  } finally {
    await page.close();
    server.close();
  }
});
