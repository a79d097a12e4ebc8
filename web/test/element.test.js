// SPDX-License-Identifier: Apache-2.0
// <l4d-player> as part of a page: its properties and promises, the rules of the page, and what a stream says of its
// presentation.
import assert from 'node:assert/strict';
import {join} from 'node:path';
import {after, before, test} from 'node:test';
import {launch, newPage, opened, serve, work} from './browser.js';

let browser, server;
before(async () => {
  browser = await launch();
  const names = ['short', 'frames', 'drawn', 'dilated'];
  server = await serve(Object.fromEntries(names.map(name => [`${name}.l4d`, join(work, `${name}.l4d`)])));
});
after(async () => {
  await browser?.close();
  server?.close();
});

/**
 * Runs fn with a page.
 * @param {string} body @param {(page: any) => Promise<void>} fn
 * @param {{hash?: string, headers?: Record<string, string>, size?: [number, number], script?: string, errors?: RegExp}} [options]
 *   errors: what the page may complain of
 */
const withPage = async (body, fn, {hash = '', headers = {}, size = [480, 270], script = 'player.js', errors} = {}) => {
  const page = await newPage(browser, {viewport: {width: size[0], height: size[1]}});
  try {
    await page.route('**/page.html', route => route.fulfill({
      contentType: 'text/html', headers: {'content-type': 'text/html', ...headers},
      body: `<!doctype html><body>${body}${script && `<script type="module" src="${script}"></script>`}`
    }));
    await page.goto(`${server.url}page.html${hash}`);
    await fn(page);
    assert.deepEqual(page.errors.filter(error => !errors?.test(error)), []);
  } finally {
    await page.close();
  }
};

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
    while (movie.ready.detail !== 'full') await new Promise(resolve => setTimeout(resolve, 20));
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

for (const [width, height] of /** @type {[number, number][]} */ ([[380, 260], [390, 780]])) {
  test(`all of the menu is there at ${width} x ${height}`, () => withPage(
    `<l4d-player src="frames.l4d" id="p"></l4d-player>`, async page => {
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
