// SPDX-License-Identifier: Apache-2.0
// <l4d-player> as part of a page: its properties and promises, the rules of the page, and what a stream says of its
// presentation.
import assert from 'node:assert/strict';
import {test} from 'node:test';
import {opened} from './browser.js';
import {pagesWith} from './pages.js';

const withPage = pagesWith('short', 'frames', 'drawn', 'dilated');

const policy = "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; connect-src 'self'";

test('a strict content security policy leaves the player its styles and its picture', () => withPage(
  '<l4d-player src="short.l4d"></l4d-player>', async page => {
    await opened(page);
    const found = await page.evaluate(async () => {
      const player = document.querySelector('l4d-player');
      await player.movie.seek(1);
      const styleOf = selector => getComputedStyle(player.shadowRoot.querySelector(selector));
      const pixels = await player.view.pixels();
      return {bar: styleOf('.bar').position, canvas: styleOf('canvas').position, accent: styleOf('.done').backgroundColor, shape: player.clientWidth / player.clientHeight,
              done: styleOf('.done').width, light: pixels.reduce((a, b, k) => a + (k % 4 === 3 ? 0 : b), 0) / pixels.length};
    });
    assert.deepEqual([found.bar, found.canvas, found.accent], ['absolute', 'absolute', 'rgb(90, 176, 255)']);
    assert.ok(Math.abs(found.shape - 16 / 9) < 0.01, `${found.shape}`);
    assert.ok(parseFloat(found.done) > 50 && found.light > 5, JSON.stringify(found));
  }, {headers: {'Content-Security-Policy': policy}}));

test('load() fails as open() does, and the player shows why', () => withPage('<l4d-player></l4d-player>', async page => {
  const answers = await page.evaluate(async () => {
    await customElements.whenDefined('l4d-player');
    const player = document.querySelector('l4d-player');
    const codes = [];
    player.addEventListener('error', event => codes.push(event.detail.code));
    const outcome = promise => promise.then(() => 'done', error => error.code === 20 ? error.name : error.code ?? error.name);
    const answers = {missing: await outcome(player.load('missing.l4d'))};
    answers.shown = player.shadowRoot.querySelector('.message').innerText;
    answers.play = await outcome(player.play());
    answers.nothing = await outcome(player.load());
    const first = outcome(player.load('short.l4d'));
    answers.second = await outcome(player.load('frames.l4d'));
    answers.first = await first;
    answers.frames = player.movie.info.numFrames;
    answers.hidden = player.shadowRoot.querySelector('.message').hidden;
    return {...answers, codes};
  });
  assert.match(answers.shown, /server does not have this file/);
  assert.deepEqual({...answers, shown: ''}, {missing: 'NOT_FOUND', shown: '', play: 'NOT_FOUND', nothing: 'INVALID_ARGUMENT', first: 'AbortError',
                                             second: 'done', frames: 30, hidden: true, codes: ['NOT_FOUND', 'INVALID_ARGUMENT']});
}, {errors: /404/}));

test('it has the properties, methods and events of media elements', () => withPage('<l4d-player loop></l4d-player>', async page => {
  const found = await page.evaluate(async () => {
    const player = document.querySelector('l4d-player');
    // Before the element is defined.
    player.src = 'short.l4d';
    player.currentTime = 1.5;
    await import('/player.js');
    const {duration, paused} = player;
    const seen = [];
    for (const type of ['play', 'pause', 'ended', 'ratechange', 'timeupdate', 'durationchange', 'open']) {
      player.addEventListener(type, () => seen.push(type));
    }
    player.playbackRate = 4;
    const found = {before: [duration, paused, player.currentTime, player.autoplay, player.loop],
                   src: [player.src === new URL('short.l4d', location.href).href, player.getAttribute('src')]};
    await player.play();
    found.playing = [player.duration, player.paused, player.movie.rate, player.shadowRoot.querySelector('#rate').value,
                     player.currentTime >= 1.5 && player.currentTime < 3];
    player.loop = false;
    player.autoplay = true;
    found.attributes = [player.hasAttribute('loop'), player.hasAttribute('autoplay'), player.movie.loop];
    await new Promise(resolve => player.addEventListener('ended', resolve, {once: true}));
    found.ended = [player.ended, player.paused, player.currentTime];
    player.currentTime = 0.5;
    found.sought = [player.currentTime, player.ended];
    const canceled = player.play().catch(error => error.name);
    player.pause();
    found.canceled = await canceled;
    for (const name of ['currentTime', 'playbackRate']) {
      try { player[name] = NaN; } catch (error) { (found.wrong ??= []).push(error.name); }
    }
    return {...found, seen: [...new Set(seen)]};
  });
  assert.deepEqual({...found, seen: found.seen.sort()}, {
    before: [NaN, true, 1.5, false, true], src: [true, 'short.l4d'], playing: [4, false, 4, '4', true],
    attributes: [false, true, false], ended: [true, true, 4], sought: [0.5, false], canceled: 'AbortError',
    wrong: ['TypeError', 'TypeError'], seen: ['durationchange', 'ended', 'open', 'pause', 'play', 'ratechange', 'timeupdate']
  });
}, {script: ''}));

test('two views show one movie', () => withPage('', async page => {
  const found = await page.evaluate(async () => {
    const {open, View} = await import('/player.js');
    const canvases = [0, 1].map(() => Object.assign(document.createElement('canvas'), {width: 160, height: 90}));
    document.body.append(...canvases);
    const movie = await open('short.l4d');
    const errors = [];
    movie.on('error', error => errors.push(error.message));
    const views = canvases.map(canvas => new View(canvas, {exact: true}));
    for (const view of views) {
      await view.show(movie);
      view.setCamera({worldToCamera: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 6], fx: 100, fy: 100, cx: 80, cy: 45, nearPlane: 0.01});
    }
    await movie.seek(2);
    await until(() => movie.ready.detail === 'full', 'all of the instant');
    const pictures = [];
    for (const view of views) pictures.push(await view.pixels());
    const visible = views.map(view => view.stats.visible);
    views[0].dispose();
    await movie.seek(3);
    const alone = await views[1].pixels();
    const sum = pixels => pixels.reduce((a, b, k) => a + (k % 4 === 3 ? 0 : b), 0) / pixels.length;
    return {errors, visible, light: sum(pictures[0]), alone: sum(alone),
            same: pictures[0].every((value, k) => value === pictures[1][k])};
  });
  assert.deepEqual(found.errors, []);
  assert.ok(found.visible[0] > 100 && found.visible[0] === found.visible[1], `${found.visible}`);
  assert.ok(found.same && found.light > 2 && found.alone > 2, JSON.stringify(found));
}));

/** Waits for all players of a page. @param {any} page */
const allOpened = page => page.waitForFunction(() => {
  const players = [...document.querySelectorAll('l4d-player')];
  return players.every(player => player.isOpen);
});
const times = page => page.evaluate(() => [...document.querySelectorAll('l4d-player')].map(player => player.currentTime));
const two = '<l4d-player src="frames.l4d"></l4d-player><l4d-player id="b c" src="frames.l4d"></l4d-player>';

test('a link moves the first player, or the one that it names', async () => {
  await withPage(two, async page => {
    await allOpened(page);
    assert.deepEqual(await times(page), [0.5, 0]);
  }, {hash: '#t=0.5'});
  let link = '';
  await withPage(two, async page => {
    await allOpened(page);
    assert.deepEqual(await times(page), [0, 0.5]);
    link = await page.evaluate(() => document.getElementById('b c').link);
  }, {hash: '#t=0.5&player=b%20c'});
  assert.match(link, /#t=0\.500&cam=[^&]+&player=b%20c$/);
});

test('one button to play is in the order of the Tab key', () => withPage('<l4d-player src="frames.l4d"></l4d-player>', async page => {
  await opened(page);
  await page.waitForFunction(() => !document.querySelector('l4d-player').shadowRoot.querySelector('.big').hidden);
  const names = [];
  for (let k = 0; k < 7; ++k) {
    await page.keyboard.press('Tab');
    names.push(await page.evaluate(() => document.querySelector('l4d-player').shadowRoot.activeElement?.getAttribute('aria-label')));
  }
  assert.equal(names.filter(name => name === 'Play').length, 1, names.join());
  assert.equal(await page.getByRole('button', {name: 'Play'}).count(), 1);
}));

for (const [width, height] of /** @type {[number, number][]} */ ([[380, 260], [640, 360], [390, 780]])) {
  test(`all of the menu is there at ${width} x ${height}`, () => withPage(
    `<l4d-player src="frames.l4d" id="p" lang="de"><track kind="captions" srclang="en"></l4d-player>`, async page => {
      await opened(page);
      const found = await page.evaluate(([width, height]) => {
        const player = document.querySelector('l4d-player');
        for (const [name, value] of Object.entries({position: 'fixed', inset: '0', width: `${width}px`, height: `${height}px`, 'aspect-ratio': 'auto'})) {
          player.style.setProperty(name, value);
        }
        player.toggleMenu(true);
        const box = player.getBoundingClientRect();
        const menu = player.shadowRoot.querySelector('.menu');
        const inside = element => {
          const own = element.getBoundingClientRect();
          return own.top >= box.top && own.left >= box.left && own.right <= box.right && own.bottom <= box.bottom;
        };
        return {size: [box.width, box.height], outside: [...menu.children].filter(e => !inside(e)).map(e => e.outerHTML.slice(0, 40)),
                scrolls: menu.scrollHeight - menu.clientHeight};
      }, [width, height]);
      assert.deepEqual(found, {size: [width, height], outside: [], scrolls: 0});
    }, {size: [width, height]}));
}

test('a stream says how it is played, and where the camera is', () => withPage(
  '<l4d-player src="drawn.l4d"></l4d-player>', async page => {
    await opened(page);
    const found = await page.evaluate(() => {
      const {movie, view} = document.querySelector('l4d-player');
      const {worldToCamera: m, fy} = view.camera();
      const center = [0, 1, 2].map(c => -(m[c] * m[3] + m[4 + c] * m[7] + m[8 + c] * m[11]));
      return {playback: movie.playback, target: view.orbit.target, center, up: m[5] > 0.9,
              fov: 2 * Math.atan(view.canvas.height / 2 / fy) * 180 / Math.PI};
    });
    assert.deepEqual([found.playback, found.target, found.up], ['loop', [0, 0.25, 0.5], true]);
    found.center.forEach((v, k) => assert.ok(Math.abs(v - [0.5, -1, -6][k]) < 1e-6, `${found.center}`));
    assert.ok(Math.abs(found.fov - 40) < 1e-3, `${found.fov}`);
  }));

test('ping-pong goes there and back, at the bounds of the stream', () => withPage(
  '<l4d-player src="dilated.l4d"></l4d-player>', async page => {
    await opened(page);
    const found = await page.evaluate(async () => {
      const player = document.querySelector('l4d-player');
      const {movie, view} = player;
      const seen = [];
      const ended = [];
      player.addEventListener('timeupdate', () => seen.push(player.currentTime));
      player.addEventListener('ended', () => ended.push(player.currentTime));
      const turned = () => {
        const most = seen.findIndex(t => t >= movie.duration);
        return most >= 0 && seen.slice(most).some(t => t <= 0) && seen.at(-1) > 0.1;
      };
      player.playbackRate = 2;
      await player.play();
      await until(turned, 'the way there and back');
      const playing = !player.paused;
      player.setAttribute('playback', 'once');
      const after = movie.playback;
      return {turned: turned(), playing, ended, after, target: view.orbit.target, distance: view.orbit.distance,
              playback: movie.info.presentation.playback, rate: player.playbackRate};
    });
    const {distance, ...rest} = found;
    assert.deepEqual(rest, {turned: true, playing: true, ended: [], after: 'once', target: [0, 0, 0], playback: 'ping-pong', rate: 2});
    assert.ok(Math.abs(distance - Math.hypot(2, 1, 3) / Math.sin(Math.PI / 6)) < 1e-6, `${distance}`);
  }));

test('the page has the last word on playback', () => withPage(
  '<l4d-player src="drawn.l4d" playback="once"></l4d-player><l4d-player src="dilated.l4d" loop></l4d-player>' +
  '<l4d-player src="frames.l4d" playback="auto"></l4d-player><l4d-player src="dilated.l4d" playback="auto"></l4d-player>',
  async page => {
    await allOpened(page);
    const found = await page.evaluate(() => {
      const players = [...document.querySelectorAll('l4d-player')];
      const modes = players.map(player => player.movie.playback);
      // Its user unchecks the box.
      const box = players[2].shadowRoot.querySelector('#loop');
      box.click();
      return {modes, boxes: players.map(p => p.shadowRoot.querySelector('#loop').checked), after: players[2].movie.playback};
    });
    assert.deepEqual(found, {modes: ['once', 'loop', 'loop', 'ping-pong'], boxes: [false, true, false, false], after: 'once'});
  }));
