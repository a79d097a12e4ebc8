// SPDX-License-Identifier: Apache-2.0
// <l4d-player> in browsers.
import assert from 'node:assert/strict';
import {mkdtempSync, readFileSync, rmSync} from 'node:fs';
import {tmpdir} from 'node:os';
import {join} from 'node:path';
import {after, before, test} from 'node:test';
import {complaints, heap, launch, newPage, opened, serve, work} from './browser.js';
import {recording} from './recording.js';

const stream = join(work, 'short.l4d');
let browser;
before(async () => { browser = await launch(); });
after(async () => browser?.close());

/** Runs fn with a page of the player, over a server with these faults. */
const withPlayer = async (fn, {faults = {}, options = {}, hash = '', wait = true, noErrors = true,
                                   streams = {}} = {}) => {
  const server = await serve({'scene.l4d': stream, ...streams}, faults);
  const page = await newPage(browser, {viewport: {width: 320, height: 180}, ...options});
  try {
    await page.goto(`${server.url}${hash}`);
    if (wait) {
      await opened(page);
      await page.evaluate(() => document.querySelector('l4d-player').movie.pause());
    }
    await fn(page, server);
    if (noErrors) assert.deepEqual(await complaints(page), []);
  } finally {
    await page.close();
    server.close();
  }
};

/** Calls fn in the page with the player and what is given. */
const inPlayer = (page, fn, given) =>
  page.evaluate(`(async () => (${fn})(document.querySelector('l4d-player'), ${JSON.stringify(given ?? null)}))()`);
const light = page => inPlayer(page, async player => {
  const pixels = await player.view.pixels();
  return pixels.reduce((a, b, k) => a + (k % 4 === 3 ? 0 : b), 0) / pixels.length;
});
const message = page => page.waitForFunction(() => {
  const box = document.querySelector('l4d-player').shadowRoot.querySelector('.message');
  return box.hidden ? null : box.innerText;
}).then(handle => handle.jsonValue());

test('opens, shows a picture, plays, pauses, seeks', () => withPlayer(async page => {
  assert.ok(await light(page) > 5, 'the picture is not empty');
  const moved = await inPlayer(page, async player => {
    const before = player.movie.currentTime;
    player.movie.play();
    await until(() => player.movie.currentTime >= before + 0.2, '0.2 s of playback');
    player.movie.pause();
    return player.movie.currentTime - before;
  });
  assert.ok(moved >= 0.2, `${moved} s`);
  const states = await inPlayer(page, async player => {
    await player.movie.seek(1.5);
    const slice = await player.movie.slice(1.5);
    return {time: player.movie.currentTime, count: slice.count, values: slice.position.length,
            label: player.shadowRoot.querySelector('.play').getAttribute('aria-label'),
            text: player.shadowRoot.querySelector('input').getAttribute('aria-valuetext')};
  });
  assert.equal(states.time, 1.5);
  assert.ok(states.count > 0);
  assert.equal(states.values, 3 * states.count);
  assert.equal(states.label, 'Play');
  assert.equal(states.text, '1.5 seconds of 4 seconds');
}));

test('flat windows: no picture between two frames is empty while it plays', () => withPlayer(async page => {
  await page.evaluate(() => document.querySelector('l4d-player').load('/frames.l4d'));
  await page.waitForFunction(() => document.querySelector('l4d-player').movie?.info?.numFrames === 30);
  await opened(page);
  const sums = await inPlayer(page, async player => {
    const {view, movie} = player;
    movie.pause();
    await movie.seek(0);
    await view.settled();
    const {painter, gl} = view;
    const draw = painter.draw.bind(painter);
    const seen = [];
    painter.draw = (...given) => {
      draw(...given);
      const {width, height} = view.canvas;
      const bytes = new Uint8Array(4 * width * height);
      gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
      seen.push(bytes.reduce((a, b, k) => a + (k % 4 === 3 ? 0 : b), 0) / bytes.length);
    };
    movie.play();
    await until(() => seen.length >= 12 && movie.currentTime >= 0.5, '12 pictures of half a second');
    movie.pause();
    return {seen, empty: view.background.reduce((a, b) => a + 255 * b, 0) / 4};
  });
  assert.ok(sums.seen.length >= 12, `${sums.seen.length} pictures`);
  assert.ok(Math.min(...sums.seen) > 1.2 * sums.empty, `${sums.empty}: ${sums.seen.map(v => v.toFixed(1)).join(' ')}`);
}, {streams: {'frames.l4d': join(work, 'frames.l4d')}}));

test('streams that follow each other: no picture at a border is empty while it plays', () => withPlayer(async page => {
  await inPlayer(page, player => void player.load('/members.m3u8'));
  await page.waitForFunction(() => document.querySelector('l4d-player').movie?.info?.duration > 7);
  await opened(page);
  const found = await inPlayer(page, async player => {
    const {view, movie} = player;
    const spans = [];
    Object.assign(player.style, {width: '160px', height: '90px'});
    movie.pause();
    await movie.seek(0.9);
    await view.settled();
    // Where a picture takes long, the movie goes slowly, so that there are some beside each border.
    const began = performance.now();
    for (let k = 0; k < 3; ++k) {
      view.change();
      await view.settled();
    }
    movie.rate = Math.min(Math.max(0.05 * 3000 / (performance.now() - began), 0.01), 0.2);
    // It stops at each border, however late the page is.
    let passes = () => {};
    movie.on('span', span => {
      spans.push(span.begin);
      movie.pause();
      passes();
    });
    // Each picture shows the streams that its order has Gaussians of.
    const {painter} = view;
    const [draw, setOrder] = [painter.draw.bind(painter), painter.setOrder.bind(painter)];
    const pictures = [];
    let lines = new Set();  // of the order, once there is a new one
    painter.setOrder = (order, count) => {
      lines = new Set(order.subarray(0, count).map(row => row >> 8));
      setOrder(order, count);
    };
    painter.draw = (camera, streams, ...given) => {
      draw(camera, streams, ...given);
      const shown = streams.map(s => s.stream);
      const ordered = [...painter.store.buckets.values()].filter(b => b.lines.some(line => lines.has(line))).map(b => b.stream);
      if (lines.size > 0) pictures.push({shown, ordered: [...new Set(ordered)]});
    };
    for (const border of [1, 2, 3]) {
      await movie.seek(border - 0.1);
      await view.settled();
      const passed = new Promise(resolve => { passes = () => resolve(undefined); });
      movie.play();
      await passed;
      view.change();
      await view.settled();
    }
    return {pictures, spans};
  });
  assert.deepEqual(found.spans, [1, 2, 3]);
  assert.ok(found.pictures.length >= 4, `${found.pictures.length} pictures`);
  for (const {shown, ordered} of found.pictures) {
    assert.ok(shown.length >= 2 && ordered.length > 0 && ordered.every(stream => shown.includes(stream)), `${ordered} of ${shown}`);
  }
}, {streams: {'members.m3u8': join(work, 'members.m3u8'), 'members.l4d': join(work, 'members.l4d')}}));

test('a stream with colours of a higher degree leaves the picture as it is', () => withPlayer(async page => {
  const [degrees, differing] = await page.evaluate(async () => {
    const {open, View} = await import('/player.js');
    const canvas = Object.assign(document.createElement('canvas'), {width: 320, height: 180});
    document.body.append(canvas);
    const movie = await open('/joined.m3u8');
    const degrees = [movie.info.shDegree];
    const view = new View(canvas, {exact: true});
    // All that is uploaded goes, and comes again.
    const early = new Promise(resolve => movie.on('info', ({shDegree}) => {
      degrees.push(shDegree);
      resolve(view.pixels());
    }));
    await view.show(movie);
    view.orbit.frame({middle: [0, 0, 0], radius: 4}, 0);
    await movie.seek(0.5);
    const first = await early;
    await until(() => movie.ready.detail === 'full' && movie.secondsAhead >= 3, 'all of 3 s');
    const last = await view.pixels();
    movie.dispose();
    view.dispose();
    const lit = last.reduce((sum, v, k) => sum + (k % 4 !== 3 && v > 0 ? 1 : 0), 0);
    return [degrees, first.reduce((sum, v, k) => sum + (Math.abs(v - last[k]) > 2 ? 1 : 0), 0) / lit];
  });
  assert.deepEqual(degrees.filter((d, k) => d !== degrees[k - 1]), [0, 3]);
  assert.ok(differing < 0.01, `${differing} of the picture changed`);
}, {streams: {'joined.m3u8': join(work, 'joined.m3u8'), 'joined.l4d': join(work, 'joined.l4d')}}));

test('a recording is followed while it grows, and to its end', async () => {
  const folder = mkdtempSync(join(tmpdir(), 'l4dlive-'));
  const live = recording(join(work, 'members'), folder);
  live.publish(4);
  try {
    await withPlayer(async page => {
      // Else it plays at once, and waits at the end before anyone listens.
      await page.emulateMedia({reducedMotion: 'reduce'});
      await inPlayer(page, player => void player.load('/live.m3u8'));
      await page.waitForFunction(() => document.querySelector('l4d-player').movie?.live);
      await opened(page);
      const end = () => inPlayer(page, player => player.shadowRoot.querySelector('.end').textContent);
      assert.equal(await end(), 'live');
      const first = await inPlayer(page, player => [player.movie.timeEnd, player.movie.startTime, player.movie.currentTime]);
      assert.ok(Math.abs(first[0] - 4) < 1e-3 && first[1] > 1 && first[2] >= first[1], `${first}`);
      await inPlayer(page, player => {
        globalThis.states = [];
        for (const type of ['stall', 'resume', 'ended', 'grown']) player.movie.on(type, () => globalThis.states.push(type));
        player.movie.loop = false;
        player.movie.play();
      });
      // At the end of now it waits, and goes on.
      await page.waitForFunction(() => globalThis.states.includes('stall'));
      assert.ok(await inPlayer(page, player => player.movie.currentTime <= player.movie.timeEnd && !player.movie.paused));
      live.publish(6);
      await page.waitForFunction(() => document.querySelector('l4d-player').movie.currentTime > 4.2);
      live.publish(Infinity);
      await page.waitForFunction(() => globalThis.states.includes('ended'));
      assert.equal(await end(), '0:08.0');
      const states = await page.evaluate(() => globalThis.states);
      assert.deepEqual(states.filter(s => s === 'grown'), ['grown', 'grown']);
      assert.ok(states.includes('resume'));
    }, {streams: {'live.m3u8': live.playlist, 'live.l4d': live.file}});
  } finally {
    rmSync(folder, {recursive: true});
  }
});

test('the timeline scrubs by mouse, and ends where it is let go', () => withPlayer(async page => {
  const box = await page.locator('l4d-player .track input').boundingBox();
  const y = box.y + box.height / 2;
  await inPlayer(page, player => {
    globalThis.seeks = [];
    const {movie} = player;
    const seek = movie.seek.bind(movie);
    movie.seek = (time, options) => {
      globalThis.seeks.push(options.tolerance > 0);
      return seek(time, options);
    };
  });
  await page.mouse.move(box.x + box.width * 0.25, y);
  await page.mouse.down();
  await page.mouse.move(box.x + box.width * 0.75, y, {steps: 4});
  await page.waitForFunction(() => document.querySelector('l4d-player').movie.currentTime > 2.5);
  await page.mouse.up();
  const [time, seeks, hover] = await inPlayer(page, player => [
    player.movie.currentTime, globalThis.seeks, player.shadowRoot.querySelector('.hover').textContent]);
  assert.ok(Math.abs(time - 3) < 0.15, `${time}`);
  assert.ok(seeks.length >= 3 && seeks.slice(0, -1).every(Boolean) && !seeks.at(-1), `${seeks}`);
  assert.match(hover, /^0:0[23]\.\d$/);
}));

test('keys are those of video players', () => withPlayer(async page => {
  await page.locator('l4d-player canvas').focus();
  const time = () => inPlayer(page, player => player.movie.currentTime);
  await page.keyboard.press('End');
  assert.equal(await time(), 4);
  await page.keyboard.press('Home');
  assert.equal(await time(), 0);
  await page.keyboard.press('l');
  assert.ok(Math.abs(await time() - 0.8) < 1e-6);
  await page.keyboard.press('.');
  await page.keyboard.press('.');
  await page.keyboard.press(',');
  assert.ok(Math.abs(await time() - 0.8 - 1 / 30) < 1e-6);
  await page.keyboard.press('ArrowRight');
  await page.keyboard.press('ArrowLeft');
  await page.keyboard.press('j');
  assert.ok(Math.abs(await time() - 1 / 30) < 1e-6);
  await page.keyboard.press('>');
  assert.equal(await inPlayer(page, player => player.movie.rate), 2);
  await page.keyboard.press('<');
  await page.keyboard.press('i');
  assert.equal(await inPlayer(page, player => player.shadowRoot.querySelector('.overlay').hidden), false);
  // The first view follows from the Gaussians that are there. Once all of this instant are, it stays the same.
  const eye = () => inPlayer(page, player => player.view.orbit.eye());
  await inPlayer(page, player => player.view.settled());
  await page.keyboard.press('0');
  await inPlayer(page, player => player.view.settled());
  const before = await eye();
  await page.keyboard.press('Alt+ArrowLeft');
  assert.notDeepEqual(await eye(), before);
  await page.keyboard.press('0');
  await page.waitForFunction(([x]) => Math.abs(document.querySelector('l4d-player').view.orbit.eye()[0] - x) < 1e-6, before);
  await page.keyboard.press(' ');
  assert.equal(await inPlayer(page, player => player.movie.paused), false);
  await page.keyboard.press('k');
  assert.equal(await inPlayer(page, player => player.movie.paused), true);
}));

test('pointers turn, move and zoom; a tap plays', () => withPlayer(async page => {
  const state = () => inPlayer(page, player => player.view.orbit.state());
  const first = await state();
  await page.mouse.move(200, 100);
  await page.mouse.down();
  await page.mouse.move(260, 120, {steps: 3});
  await page.mouse.up();
  const turned = await state();
  assert.notEqual(turned.yaw, first.yaw);
  assert.equal(turned.distance, first.distance);
  assert.equal(await inPlayer(page, player => player.movie.paused), true);
  await page.mouse.wheel(0, 240);
  await page.waitForFunction(d => document.querySelector('l4d-player').view.orbit.distance > d, first.distance);
  await page.mouse.down({button: 'right'});
  await page.mouse.move(200, 100, {steps: 3});
  await page.mouse.up({button: 'right'});
  assert.notDeepEqual((await state()).target, first.target);
  await page.mouse.click(60, 60);
  await page.waitForFunction(() => !document.querySelector('l4d-player').movie.paused, undefined, {timeout: 5000});
}, {options: {viewport: {width: 480, height: 270}}}));

test('roles, names and focus', () => withPlayer(async page => {
  const unnamed = await inPlayer(page, player => [...player.shadowRoot.querySelectorAll('button, input, select, canvas')]
    .filter(e => !(e.getAttribute('aria-label') || e.labels?.[0]?.textContent || e.textContent.trim())).map(e => e.outerHTML));
  assert.deepEqual(unnamed, []);
  await page.getByRole('slider', {name: 'Time'}).focus();
  for (const name of ['Play', 'Show the whole scene', 'Settings', 'Full screen']) {
    await page.keyboard.press('Tab');
    assert.equal(await inPlayer(page, player => player.shadowRoot.activeElement.getAttribute('aria-label')), name);
    assert.notEqual(await inPlayer(page, player => getComputedStyle(player.shadowRoot.activeElement).outlineStyle), 'none');
  }
  await page.getByRole('button', {name: 'Settings'}).click();
  assert.equal(await page.getByRole('button', {name: 'Settings'}).getAttribute('aria-expanded'), 'true');
  await page.getByLabel('Detail').selectOption('base');
  assert.equal(await inPlayer(page, player => player.movie.detail), 'base');
  await page.getByLabel('Camera').selectOption('fly');
  assert.equal(await inPlayer(page, player => player.pointer.mode), 'fly');
  await page.keyboard.press('Escape');
  assert.equal(await inPlayer(page, player => player.shadowRoot.querySelector('.menu').hidden), true);
  assert.match(await page.getByRole('status').innerText(), /\w/);
}));

test('a file that is dropped is played', () => withPlayer(async page => {
  await page.evaluate(base64 => {
    const bytes = Uint8Array.from(atob(base64), c => c.charCodeAt(0));
    const transfer = new DataTransfer();
    transfer.items.add(new File([bytes], 'other.l4d'));
    const player = document.querySelector('l4d-player');
    player.dispatchEvent(new DragEvent('dragover', {dataTransfer: transfer, cancelable: true}));
    globalThis.marked = player.hasAttribute('dragging');
    player.dispatchEvent(new DragEvent('drop', {dataTransfer: transfer, cancelable: true}));
  }, readFileSync(join(work, 'indexed.l4d')).toString('base64'));
  assert.equal(await page.evaluate(() => globalThis.marked), true);
  await page.waitForFunction(size => document.querySelector('l4d-player').movie?.info?.fileBytes === size,
                             readFileSync(join(work, 'indexed.l4d')).length);
  await opened(page);
  assert.ok(await light(page) > 5);
}));

test('pixels of a movie that plays are answered, however slowly rows are sorted', () => withPlayer(async page => {
  const settled = await inPlayer(page, async player => {
    // Orders come when time has moved on.
    const {sorter} = player.view;
    const post = sorter.postMessage.bind(sorter);
    sorter.postMessage = (data, transfer) => {
      if (data.type === 'sort') setTimeout(() => post(data, transfer ?? []), 200);
      else post(data, transfer ?? []);
    };
    player.movie.playback = 'loop';
    const {currentTime} = player.movie;
    player.movie.play();
    await until(() => player.movie.currentTime !== currentTime, 'playback');
    await new Promise(resolve => setTimeout(resolve, 300));
    const pixels = player.view.pixels().then(values => values.length);
    const result = await Promise.race([pixels, new Promise(resolve => setTimeout(resolve, 60000, 'late'))]);
    player.movie.pause();
    return result;
  });
  assert.equal(typeof settled, 'number', `${settled}`);
}));

test('links have time and camera', () => withPlayer(async (page, server) => {
  const link = await inPlayer(page, async player => {
    player.view.orbit.orbit(0.5, 0.2);
    await player.movie.seek(2.25);
    return player.link;
  });
  const state = await inPlayer(page, player => player.view.orbit.state());
  assert.match(link, /#t=2\.250&cam=/);
  await page.goto('about:blank');
  // Else it plays at once, and begins anew before a busy machine looks.
  await page.emulateMedia({reducedMotion: 'reduce'});
  await page.goto(link);
  await opened(page);
  const again = await inPlayer(page, player => player.view.orbit.state());
  assert.ok(Math.abs(again.yaw - state.yaw) < 1e-3 && Math.abs(again.distance - state.distance) < 1e-3);
  assert.ok(await inPlayer(page, player => player.movie.currentTime) >= 2.25);
  assert.ok(server.requests.length > 0);
}));

test('a lost context comes back with the picture', () => withPlayer(async page => {
  const before = await light(page);
  await inPlayer(page, async player => {
    const lose = player.view.gl.getExtension('WEBGL_lose_context');
    const canvas = player.view.canvas;
    const lost = new Promise(r => canvas.addEventListener('webglcontextlost', r, {once: true}));
    const restored = new Promise(r => canvas.addEventListener('webglcontextrestored', r, {once: true}));
    lose.loseContext();
    await lost;
    await new Promise(r => setTimeout(r, 50));
    lose.restoreContext();
    await restored;
    const rows = new Promise(r => player.movie.on('ready', v => v.detail === 'full' && r()));
    await rows;
  });
  assert.ok(Math.abs(await light(page) - before) < 0.5);
}, {noErrors: false}));

test('players that are removed give their contexts back', () => withPlayer(async page => {
  const lost = await inPlayer(page, async player => {
    let lost = 0;
    player.view.canvas.addEventListener('webglcontextlost', () => ++lost);
    for (let k = 0; k < 24; ++k) {
      const other = document.createElement('l4d-player');
      document.body.append(other);
      if (other.view) return 'a player with nothing to show has a context';
      other.load('scene.l4d').catch(() => {});
      const {ready, canvas} = other.view;
      // Every other one is removed before it is known what draws.
      if (k % 2 === 0) {
        await ready;
        if (other.view.gl.isContextLost()) return 'a new player has no context';
      }
      other.remove();
      await ready;
      await null;
      if (!canvas.getContext('webgl2').isContextLost()) return 'a removed player keeps its context';
    }
    await new Promise(resolve => setTimeout(resolve, 100));
    return lost;
  });
  assert.equal(lost, 0);
  assert.ok(await light(page) > 1);
}));

test('a view that is given up before it draws leaves its canvas to the next', () => withPlayer(async page => {
  const isLost = await page.evaluate(async () => {
    const {View} = await import('/player.js');
    const canvas = document.createElement('canvas');
    const first = new View(canvas, {backend: 'auto'});
    first.dispose();
    const next = new View(canvas, {backend: 'auto'});
    await Promise.all([first.ready, next.ready]);
    const isLost = next.gl.isContextLost();
    next.dispose();
    return isLost;
  });
  assert.equal(isLost, false);
}));

test('wrong arguments and calls after the end are answered', () => withPlayer(async page => {
  const answers = await inPlayer(page, async player => {
    const {open, View} = await import('/player.js');
    const code = promise => promise.then(() => 'done', error => error.code === 20 ? error.name : error.code ?? error.name);
    const {movie, view} = player;
    const bytes = new Uint8Array(await (await fetch('scene.l4d')).arrayBuffer());
    const copy = await open(bytes.subarray(0));
    const answers = {
      view: copy.duration === movie.duration && bytes.length > 0,
      null: await code(open(null)), number: await code(open(7)), address: await code(open('http://[')),
      relative: await code(open('scene.l4d', {wasmUrl: 'l4d.wasm'}).then(m => m.dispose())),
      nan: await code(movie.seek(NaN)), time: movie.currentTime
    };
    try { movie.rate = NaN; } catch (error) { answers.rate = [error.code, movie.rate]; }
    let heard = 0;
    const ends = [movie.on('play', () => { throw new Error('of a listener'); }), movie.on('play', () => ++heard)];
    movie.play();
    movie.pause();
    for (const end of ends) end();
    answers.heard = heard;
    copy.dispose();
    answers.gone = await code(copy.seek(1));
    view.hide();
    answers.nothing = await code(view.pixels());
    const other = new View(document.createElement('canvas'));
    const bounds = other.bounds();
    other.dispose();
    answers.bounds = [await bounds, await other.bounds()];
    await other.home();
    await other.settled();
    return answers;
  });
  const {time, ...rest} = answers;
  assert.ok(Number.isFinite(time));
  assert.deepEqual(rest, {view: true, null: 'INVALID_ARGUMENT', number: 'INVALID_ARGUMENT', address: 'INVALID_ARGUMENT',
                          relative: 'done', nan: 'INVALID_ARGUMENT', rate: ['INVALID_ARGUMENT', 1], heard: 1,
                          gone: 'AbortError', nothing: 'Error', bounds: [null, null]});
  assert.deepEqual((await complaints(page)).splice(0), ['Error: of a listener']);
}));

test('reduced motion does not play by itself', () => withPlayer(async page => {
  await opened(page);
  assert.equal(await inPlayer(page, player => player.movie.paused), true);
  assert.equal(await inPlayer(page, player => player.shadowRoot.querySelector('.big').hidden), false);
}, {options: {reducedMotion: 'reduce'}, wait: false}));

test('a server without ranges', () => withPlayer(async (page, server) => {
  assert.ok(await light(page) > 5);
  assert.equal(server.requests.length, 1);
}, {faults: {ranges: false}}));

test('a slow network: base colours first, then all', () => withPlayer(async (page, server) => {
  // Behind the header nothing comes until the worker knows the instant, so that nothing is here from another one.
  let release = () => {};
  const held = new Promise(resolve => { release = () => resolve(undefined); });
  server.faults.hold = begin => begin > 0 ? held : undefined;
  await page.evaluate(async () => {
    const {open} = await import('/player.js');
    const slow = await open('/long.l4d');
    const seen = [];
    slow.on('ready', ready => seen.push(ready.detail));
    void slow.seek(2);
    await slow.refreshStatistics();
    Object.assign(globalThis, {slow, seen});
  });
  release();
  await page.waitForFunction(() => globalThis.seen.includes('full'), undefined, {timeout: 300000});
  const seen = await page.evaluate(() => {
    const {slow, seen} = /** @type {any} */ (globalThis);
    slow.dispose();
    return seen;
  });
  assert.equal(seen[0], 'base');
  // Of a small stream one request has it all.
}, {faults: {rate: 4, delay: 50}, streams: {'long.l4d': join(work, 'long.l4d')}}));

test('tiers come one after the other, and the last tier can be chosen', () => withPlayer(async (page, server) => {
  // Behind the header nothing comes until the worker knows the instant, so that no tier is here from another one.
  let release = () => {};
  const held = new Promise(resolve => { release = () => resolve(undefined); });
  server.faults.hold = begin => begin > 0 ? held : undefined;
  server.faults.rate = 8;  // Mbit/s: on a fast link the first tiers come together
  await page.evaluate(async () => {
    const {open} = await import('/player.js');
    const tiers = await open('/tiers.l4d');
    const seen = [];
    tiers.on('ready', ready => seen.push(`${ready.detail} ${ready.tier}`));
    void tiers.seek(2);
    await tiers.refreshStatistics();
    Object.assign(globalThis, {tiers, seen});
  });
  release();
  await page.waitForFunction(() => globalThis.seen.includes('full 2'), undefined, {timeout: 300000});
  const found = await page.evaluate(async () => {
    const {tiers, seen} = /** @type {any} */ (globalThis);
    const all = [...new Set(seen)];
    const counts = [], limited = [];
    for (const maxTier of [0, 1, 2]) counts.push((await tiers.slice(2, {maxTier})).count);
    tiers.maxTier = 0;
    tiers.on('ready', ready => limited.push(ready.tier));
    await tiers.seek(6);
    tiers.dispose();
    return {all, counts, limited, lastTier: tiers.info.lastTier};
  });
  assert.ok(found.all[0] === 'base 0' && found.all.at(-1) === 'full 2', `${found.all}`);
  // Some come together, but none before a lower one.
  const ladder = ['base 0', 'base 1', 'base 2', 'full 2'];
  assert.deepEqual(found.all, ladder.filter(rung => found.all.includes(rung)));
  assert.ok(found.counts[0] < found.counts[1] && found.counts[1] < found.counts[2], `${found.counts}`);
  assert.ok(found.limited.length > 0 && found.limited.every(tier => tier === 0), `${found.limited}`);
  assert.equal(found.lastTier, 2);
}, {streams: {'tiers.l4d': join(work, 'tiers.l4d')}}));

for (const [name, faults, words] of /** @type {[string, any, RegExp][]} */ ([
  ['404', {status: 404}, /server does not have this file/], ['403', {status: 403}, /server refuses this file/], ['416', {status: 416}, /cut short/],
  ['500', {status: 500}, /server does not answer/]
])) {
  test(`an answer of ${name} is told`, () => withPlayer(async page => {
    assert.match(await message(page), words);
  }, {faults, wait: false, noErrors: false}));
}

test('a file that is cut short says so over the picture, and a whole one takes that back', () => withPlayer(async page => {
  const note = () => inPlayer(page, player => {
    const box = player.shadowRoot.querySelector('.note');
    return box.hidden ? '' : box.textContent;
  });
  assert.equal(await note(), '');
  const load = (/** @type {string} */ base64) => inPlayer(page, (player, text) => {
    void player.load(Uint8Array.from(atob(text), c => c.charCodeAt(0)));
  }, base64);
  const bytes = readFileSync(join(work, 'tiers.l4d'));
  await load(bytes.subarray(0, Math.floor(0.75 * bytes.length)).toString('base64'));
  await page.waitForFunction(() => !document.querySelector('l4d-player').shadowRoot.querySelector('.note').hidden);
  await opened(page);
  assert.match(await note(), /^This file is cut short – Parts that cannot be shown: \d – Parts without detail of colours: 1$/);
  const losses = await inPlayer(page, player => player.movie.losses);
  assert.ok(losses.length > 1 && losses.every(l => l.code === 'TRUNCATED' && l.clause === 'CHNK-1' && l.offset > 0));
  await load(bytes.toString('base64'));
  await page.waitForFunction(() => document.querySelector('l4d-player').shadowRoot.querySelector('.note').hidden);
  await opened(page);
  assert.equal(await inPlayer(page, player => player.movie.losses.length), 0);
}));

for (const [what, headers] of Object.entries({
  'allows pages to read it': {}, 'exposes what docs/web.md says': {'Access-Control-Expose-Headers': 'Content-Range, ETag'}
})) {
  test(`a server of another origin that ${what} and answers no OPTIONS plays`, () => withPlayer(async page => {
    const other = await serve({'scene.l4d': stream}, {headers: {'Access-Control-Allow-Origin': '*', ...headers}});
    try {
      const found = await inPlayer(page, async (player, url) => {
        await player.load(url);
        await player.movie.seek(player.movie.timeEnd - 0.2);
        return [(await player.movie.slice(player.movie.currentTime)).count, player.movie.losses.length];
      }, `${other.url}scene.l4d`);
      assert.ok(found[0] > 0 && found[1] === 0, `${found}`);
      assert.ok(other.methods.length > 1 && other.methods.every(method => method === 'GET'), `${other.methods}`);
    } finally {
      other.close();
    }
  }, {wait: false}));
}

test('a server of another origin that allows nothing: the player says what it must allow', () => withPlayer(async page => {
  const other = await serve({'scene.l4d': stream});
  await inPlayer(page, (player, url) => void player.load(url), `${other.url}scene.l4d`);
  assert.match(await message(page), /Access-Control-Allow-Origin/);
  other.close();
}, {noErrors: false}));

test('a browser without WebGL2 is told', () => withPlayer(async page => {
  const [code, name, text] = await page.evaluate(async () => {
    const {View} = await import('/player.js');
    const canvas = document.createElement('canvas');
    canvas.getContext('2d');  // which leaves no other one
    try {
      new View(canvas);
    } catch (error) {
      return [error.code, error.name, error.message];
    }
    return [];
  });
  assert.deepEqual([code, name], ['WEBGL2', 'L4DError']);
  assert.match(text, /offers no WebGL2/);
}));

test('a file that changes is told, and so is a lost server; trying again helps', () => {
  // What lies behind the header, which is more than one request takes, comes after the change: this is the first load, or the
  // browser would complete what it has kept.
  let release = () => {};
  const held = new Promise(resolve => { release = () => resolve(undefined); });
  const slow = {timeout: 120000};  // machines that draw without a GPU, and do something else meanwhile
  return withPlayer(async (page, server) => {
    await page.waitForFunction(() => document.querySelector('l4d-player').movie, undefined, slow);
    server.faults.etag = '"2"';
    release();
    const says = (/** @type {string} */ words) => page.waitForFunction(wanted => {
      const box = document.querySelector('l4d-player').shadowRoot.querySelector('.message');
      return !box.hidden && box.innerText.includes(wanted);
    }, words, slow);
    await says('file has changed');
    server.faults.status = 503;
    await page.getByRole('button', {name: 'Try again'}).click();
    await says('does not answer');
    server.faults.status = 0;
    await page.getByRole('button', {name: 'Try again'}).click();
    await opened(page);
    assert.ok(await light(page) > 5);
  }, {faults: {hold: begin => begin > 0 ? held : undefined}, streams: {'scene.l4d': join(work, 'lossless.l4d')}, wait: false,
      noErrors: false});
});

test('memory stays flat over 200 seeks', () => withPlayer(async page => {
  const memory = async () => {
    const {bytes} = await heap(page);
    return [bytes, await inPlayer(page, player => player.movie.statistics.memoryBytes)];
  };
  const seeks = n => inPlayer(page, async (player, count) => {
    for (let k = 0; k < count; ++k) await player.movie.seek((k * 37 % 40) / 10);
    await player.view.settled();
  }, n);
  await seeks(20);
  const before = await memory();
  await seeks(200);
  const after = await memory();
  assert.ok(after[0] < before[0] + 4e6, `${before[0]} to ${after[0]} bytes of JavaScript`);
  assert.ok(after[1] <= before[1] + 1e6, `${before[1]} to ${after[1]} bytes of the worker`);
}));
