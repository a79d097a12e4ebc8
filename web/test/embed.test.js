// SPDX-License-Identifier: Apache-2.0
// <l4d-player> in pages of others: without WebGL2, moved and removed, far below, many of them, on another origin, in an article.
import assert from 'node:assert/strict';
import {mkdtempSync, readFileSync, rmSync, writeFileSync} from 'node:fs';
import {tmpdir} from 'node:os';
import {join} from 'node:path';
import {pathToFileURL} from 'node:url';
import {after, before, test} from 'node:test';
import {complaints, heap, launch, newPage, opened, root, serve, swipe, work} from './browser.js';

let browser, server;
const poster = 'data:image/svg+xml,<svg xmlns="http://www.w3.org/2000/svg" width="16" height="9"><rect width="16" height="9" fill="teal"/></svg>';
before(async () => {
  browser = await launch();
  server = await serve({'scene.l4d': join(work, 'short.l4d'), 'tiny.l4d': join(work, 'frames.l4d'), 'long.l4d': join(work, 'long.l4d')});
});
after(async () => {
  await browser?.close();
  server?.close();
});

/**
 * @param {string} body @param {(page: any) => Promise<void>} fn
 * @param {{headers?: Record<string, string>, size?: [number, number], script?: string, errors?: RegExp, on?: any, options?: any}} [options]
 */
const withPage = async (body, fn, {headers = {}, size = [480, 400], script = 'player.js', errors, on = browser, options = {}} = {}) => {
  const page = await newPage(on, {viewport: {width: size[0], height: size[1]}, ...options});
  try {
    server.faults.page = {headers, body: `<!doctype html><link rel="icon" href="data:,"><body>${body}<script type="module" src="${script}"></script>`};
    const from = server.requests.length;
    page.fetched = () => server.requests.slice(from).length;
    await page.goto(`${server.url}page.html`);
    await page.waitForFunction(() => Boolean(customElements.get('l4d-player')));
    await fn(page);
    assert.deepEqual((await complaints(page)).filter(error => !errors?.test(error)), []);
  } finally {
    await page.close();
  }
};
const playerOf = '<l4d-player src="scene.l4d"></l4d-player>';
const sleep = ms => new Promise(resolve => setTimeout(resolve, ms));
/** For screenshots that are looked at: L4D_SHOTS names a folder. @param {any} page @param {string} name */
const shot = (page, name) => process.env.L4D_SHOTS ? page.screenshot({path: join(process.env.L4D_SHOTS, `${name}.png`)}) : undefined;

test('without WebGL2: load() rejects, the poster or the fallback stays, nothing is fetched, one error', async () => {
  const without = await launch({webgl: false});
  try {
    await withPage(`<l4d-player poster='${poster}'><img slot="fallback" src='${poster}' alt="A still of the scene"></l4d-player>`, async page => {
      const found = await page.evaluate(async () => {
        const player = document.querySelector('l4d-player');
        const errors = [];
        player.addEventListener('error', event => errors.push(event.detail.code));
        player.addEventListener('open', () => errors.push('open'));
        const outcome = await player.load('scene.l4d').then(() => 'done', error => error.code);
        const box = player.shadowRoot.querySelector('.message');
        return {outcome, errors, isOpen: player.isOpen, code: player.error?.code, network: player.networkState, hidden: box.hidden,
                poster: getComputedStyle(player.shadowRoot.querySelector('.poster')).opacity,
                fallback: player.querySelector('img').getBoundingClientRect().height > 100,
                below: box.getBoundingClientRect().height < player.clientHeight / 2};
      });
      await shot(page, 'no-webgl2');
      assert.deepEqual(found, {outcome: 'WEBGL2', errors: ['WEBGL2'], isOpen: false, code: 4, network: 3, hidden: false, poster: '1',
                               fallback: true, below: true});
      assert.equal(page.fetched(), 0);
    }, {on: without});
  } finally {
    await without.close();
  }
});

for (const state of /** @type {const} */ (['closed', 'opening', 'open'])) {
  test(`players that are removed are collected: ${state} ones`, () => withPage('', async page => {
    await page.evaluate(async ({state, count}) => {
      const add = async () => {
        const player = document.createElement('l4d-player');
        document.body.append(player);
        const opening = state === 'closed' ? null : player.load('tiny.l4d');
        if (state === 'open') await opening;
        opening?.catch(() => {});
        if (state === 'opening') await new Promise(resolve => requestAnimationFrame(() => requestAnimationFrame(resolve)));
        player.remove();
        return new WeakRef(player);
      };
      globalThis.refs = [];
      for (let k = 0; k < count; ++k) refs.push(await add());
    }, {state, count: state === 'closed' ? 100 : 12});
    let alive = Infinity;
    for (let k = 0; k < 20 && alive > 0; ++k) {
      await sleep(100);
      await heap(page);
      alive = await page.evaluate(() => refs.filter(ref => ref.deref()).length);
    }
    assert.equal(alive, 0);
  }));
}

test('moved within the page it goes on; removed and added again it comes back as it was', () => withPage(playerOf, async page => {
  await opened(page);
  const found = await page.evaluate(async () => {
    const player = document.querySelector('l4d-player');
    await player.movie.seek(1.5);
    player.view.orbit.zoom(0.5);
    const {movie, view} = player;
    const camera = String(view.orbit);
    const box = document.createElement('div');
    document.body.append(box);
    box.append(player);
    await new Promise(resolve => setTimeout(resolve, 50));
    const moved = [player.movie === movie, player.view === view, player.currentTime, player.isOpen];
    player.remove();
    await new Promise(resolve => setTimeout(resolve, 50));
    const removed = [player.movie, player.view, movie.disposed, player.currentTime];
    document.body.append(player);
    await player.opening;
    return {moved, removed, back: [player.currentTime, String(player.view.orbit) === camera, player.paused]};
  });
  assert.deepEqual(found, {moved: [true, true, 1.5, true], removed: [null, null, true, 1.5], back: [1.5, true, true]});
}));

test('a hidden tab pauses it, and it goes on when it is seen again; one that was paused stays so', () => withPage(playerOf, async page => {
  await opened(page);
  const states = await page.evaluate(async () => {
    const player = document.querySelector('l4d-player');
    const hide = hidden => {
      Object.defineProperty(document, 'hidden', {configurable: true, value: hidden});
      document.dispatchEvent(new Event('visibilitychange'));
      return player.paused;
    };
    await player.play();
    const states = [hide(true), hide(false), player.pause(), hide(true), hide(false)];
    await player.play();
    hide(true);
    player.pause();
    return [...states, hide(false)];
  });
  assert.deepEqual(states, [true, false, undefined, true, true, true]);
}));

test('far below, with loading=lazy or preload=none, nothing is fetched until it is near, or clicked', () => withPage(
  `<l4d-player class="none" preload="none" src="scene.l4d" poster='${poster}'></l4d-player><div style="height: 4000px"></div>
   ${'<l4d-player class="lazy" loading="lazy" src="scene.l4d"></l4d-player>'.repeat(5)}`, async page => {
    await sleep(700);
    assert.equal(page.fetched(), 0);
    assert.ok(await page.evaluate(() => [...document.querySelectorAll('l4d-player')].every(player => player.view === null)), 'no context, no worker');
    await shot(page, 'poster-until-click');
    await page.click('.none .big');
    await page.waitForFunction(() => !document.querySelector('.none').paused);
    const before = page.fetched();
    assert.ok(before > 0);
    await page.evaluate(() => document.querySelector('.lazy').scrollIntoView());
    await page.waitForFunction(() => document.querySelector('.lazy').isOpen);
    assert.ok(page.fetched() > before);
  }));

test('with preload=metadata nothing but the head of the file is fetched until it is seen, played or sought', () => withPage(
  `<div style="height: 2000px"></div>${'<l4d-player src="long.l4d" preload="metadata" cache="no-store"></l4d-player>'.repeat(3)}`, async page => {
    const all = () => page.evaluate(() => [...document.querySelectorAll('l4d-player')].map(player => [player.duration, player.readyState, player.networkState,
                                                                                                    player.isOpen, player.view === null]));
    await page.evaluate(() => {
      globalThis.players = [...document.querySelectorAll('l4d-player')];
      globalThis.seen = [];
      for (const type of ['loadedmetadata', 'loadeddata', 'seeking', 'seeked', 'playing']) players[1].addEventListener(type, () => seen.push(type));
    });
    await page.waitForFunction(() => players.every(player => player.readyState > 0));
    assert.deepEqual(await all(), Array(3).fill([20, 1, 1, false, true]));
    await sleep(300);  // nothing more comes
    assert.deepEqual(server.requests.slice(-page.fetched()), Array(3).fill([0, 65536]));
    // Sought, and played from there.
    assert.deepEqual(await page.evaluate(async () => {
      players[1].currentTime = 7;
      const time = players[1].currentTime;
      await players[1].opening;
      return [time, players[1].currentTime, players[1].isOpen, players[0].isOpen];
    }), [7, 7, true, false]);
    await page.evaluate(() => players[1].play());
    assert.deepEqual(await page.evaluate(() => seen.slice(-4)), ['seeking', 'loadeddata', 'seeked', 'playing']);
    await page.evaluate(() => players[1].shadowRoot.querySelector('.play').click());
    // One that is removed while it waits is gone, and a click plays another one.
    await page.evaluate(() => {
      players[2].remove();
      players[0].shadowRoot.querySelector('.big').click();
    });
    await page.waitForFunction(() => !players[0].paused);
    await page.evaluate(() => {
      for (const player of players) player.remove();
      document.body.append(players[2]);
    });
    assert.equal(await page.evaluate(() => players[2].movie), null);
    await page.waitForFunction(() => players[2].readyState === 1);
    await page.evaluate(() => players[2].scrollIntoView());
    await page.waitForFunction(() => players[2].isOpen && players[2].paused);
  }));

test('20 players: none has a wrong error, all can be woken, and those that gave their context back keep their picture', () => withPage(
  '<l4d-player src="tiny.l4d" style="width: 240px; display: inline-block"></l4d-player>'.repeat(20), async page => {
    await page.waitForFunction(() => [...document.querySelectorAll('l4d-player')].filter(player => player.isOpen).length >= 8, undefined, {timeout: 90000});
    const found = await page.evaluate(async () => {
      const players = [...document.querySelectorAll('l4d-player')];
      const errors = [];
      for (const player of players) player.addEventListener('error', event => errors.push(String(event.detail)));
      for (const player of players.slice(8).concat(players[0])) {
        player.shadowRoot.querySelector('.big').click();
        await player.opening;
        if (!player.isOpen) errors.push('not woken');
      }
      await until(() => players.filter(player => player.view).length <= 8, 'all players but 8 to give their context back');
      return {errors, messages: players.filter(player => !player.shadowRoot.querySelector('.message').hidden).length,
              views: players.filter(player => player.view).length,
              pictures: players.filter(player => player.view || player.shadowRoot.querySelector('.still')).length};
    });
    await shot(page, 'many');
    assert.deepEqual({...found, pictures: 0}, {errors: [], messages: 0, views: 8, pictures: 0});
    assert.ok(found.pictures >= 18, `${found.pictures} pictures`);
  }, {size: [1000, 720], errors: /WebGL contexts|CONTEXT_LOST/}));

test('a lost context is no full store: the picture is back, or the player waits to be woken', () => withPage(playerOf, async page => {
  await opened(page);
  const found = await page.evaluate(async () => {
    const player = document.querySelector('l4d-player');
    const errors = [];
    player.addEventListener('error', event => errors.push(String(event.detail)));
    const lost = new Promise(resolve => player.view.canvas.addEventListener('webglcontextlost', resolve, {once: true}));
    player.view.gl.getExtension('WEBGL_lose_context').loseContext();
    await lost;
    player.movie.refresh();
    await until(() => !player.view, 'the player to give its lost context up');
    const asleep = [player.view, player.shadowRoot.querySelector('.big').hidden];
    player.shadowRoot.querySelector('.big').click();
    await player.opening;
    return {errors, asleep, isOpen: player.isOpen};
  });
  assert.deepEqual(found, {errors: [], asleep: [null, false], isOpen: true});
}, {errors: /CONTEXT_LOST/}));

test('a second src shows the poster again until its picture is there; rows are counted', () => withPage(
  `<l4d-player src="scene.l4d" poster='${poster}'></l4d-player>`, async page => {
    await opened(page);
    const found = await page.evaluate(async () => {
      const player = document.querySelector('l4d-player');
      const gone = () => player.shadowRoot.querySelector('.poster').classList.contains('gone');
      const states = [gone(), player.view.stats.rows > 0];
      player.src = 'tiny.l4d';
      states.push(gone());
      await player.opening;
      return [...states, gone(), player.view.stats.rows <= 3000];
    });
    assert.deepEqual(found, [true, true, false, true, true]);
  }));

test('attributes and options say all that open() takes', () => withPage('<l4d-player></l4d-player>', async page => {
  const found = await page.evaluate(async () => {
    const player = document.querySelector('l4d-player');
    const asked = [];
    player.options = {request: ({url, headers}) => { asked.push(headers['x-a']); return {url: `${url}?signed`}; }};
    const attributes = {headers: '{"x-a": "1"}', crossorigin: 'use-credentials', cache: 'no-store', 'cache-bytes': '100000', 'max-rows': '50000',
                        retries: '1', timeout: '5', tolerant: 'false', 'wasm-src': 'l4d.wasm', 'worker-src': 'worker.js',
                        bases: `${location.origin}/nowhere/ ${location.origin}/`};
    for (const [name, value] of Object.entries(attributes)) player.setAttribute(name, value);
    await player.load('scene.l4d');
    const {headers, request, signal, worker, ...rest} = player.movie.options;
    const bad = [];
    for (const [name, value] of [['headers', 'x'], ['timeout', 'x']]) {
      player.setAttribute(name, value);
      bad.push(await player.load('scene.l4d').catch(error => error.code));
      player.removeAttribute(name);
    }
    return {asked: [...new Set(asked)], rest: {...rest, bases: rest.bases.length}, bad};
  });
  assert.deepEqual(found, {asked: ['1'], bad: ['INVALID_ARGUMENT', 'INVALID_ARGUMENT'], rest: {
    bases: 2, cache: 'no-store', cacheBytes: 100000, credentials: 'include', maxRows: 50000, retries: 1, timeout: 5, tolerant: false, wasmUrl: 'l4d.wasm'}});
}, {errors: /404/}));

test('in an article, the wheel and a finger scroll the page; with Ctrl, after a click or with gestures=all they are for the scene', () => withPage(
  `<l4d-player src="scene.l4d" style="margin-top: 200px"></l4d-player><div style="height: 3000px"></div>`, async page => {
    await opened(page);
    const zoom = () => page.evaluate(() => String(document.querySelector('l4d-player').view.orbit));
    const scrolled = () => page.evaluate(() => scrollY);
    const wheel = async () => {
      await page.mouse.wheel(0, 60);
      await sleep(300);
    };
    const first = await zoom();
    await page.mouse.move(100, 300);
    await wheel();
    await page.waitForFunction(() => scrollY >= 60);
    assert.equal(await zoom(), first);
    await shot(page, 'hint');
    assert.match(await page.evaluate(() => document.querySelector('l4d-player').shadowRoot.querySelector('.hint').textContent), /Hold Ctrl/);
    assert.equal(await page.evaluate(() => getComputedStyle(document.querySelector('l4d-player').shadowRoot.querySelector('canvas')).touchAction), 'pan-y');
    const at = await scrolled();
    const zoomed = (/** @type {string} */ before) =>
      page.waitForFunction(was => String(document.querySelector('l4d-player').view.orbit) !== was, before);
    await page.keyboard.down('Control');
    await wheel();
    await zoomed(first);
    await page.keyboard.up('Control');
    assert.equal(await scrolled(), at);
    const second = await zoom();
    await page.evaluate(() => document.querySelector('l4d-player').setAttribute('gestures', 'all'));
    await wheel();
    await zoomed(second);
    assert.equal(await scrolled(), at);
    await page.evaluate(() => document.querySelector('l4d-player').setAttribute('gestures', 'none'));
    await sleep(700);  // another turn of the wheel
    await wheel();
    await page.waitForFunction(from => scrollY > from, at);
  }));

test('a finger that scrolls the page past the player is shown a hint, and no other one is', () => withPage(
  `<l4d-player src="scene.l4d" style="margin-top: 100px"></l4d-player><div style="height: 3000px"></div>`, async page => {
    await opened(page);
    const hint = () => page.evaluate(() => document.querySelector('l4d-player').shadowRoot.querySelector('.hint').textContent);
    const camera = () => page.evaluate(() => String(document.querySelector('l4d-player').view.orbit));
    const moved = (/** @type {string} */ before) =>
      page.waitForFunction(was => String(document.querySelector('l4d-player').view.orbit) !== was, before);
    let before = await camera();
    await swipe(page, [[[150, 150], [250, 150]]]);
    await moved(before);
    before = await camera();
    await swipe(page, [[[150, 150], [100, 160]], [[250, 150], [300, 140]]]);
    await moved(before);
    assert.deepEqual([await hint(), await page.evaluate(() => scrollY)], ['', 0]);
    await swipe(page, [[[200, 200], [200, 120]]]);
    await page.waitForFunction(() => scrollY > 20);
    await shot(page, 'hint-touch');
    assert.equal(await hint(), 'Two fingers move the camera');
    assert.equal(await page.evaluate(() => {
      const player = document.querySelector('l4d-player');
      player.setAttribute('gestures', 'all');
      return getComputedStyle(player.shadowRoot.querySelector('canvas')).touchAction;
    }), 'none');
  }, {options: {hasTouch: true}}));

/** What a player says and is that cannot load. @param {any} page */
const failed = page => page.evaluate(async () => {
  const player = document.querySelector('l4d-player');
  const errors = [];
  player.addEventListener('error', event => errors.push(event.detail.code));
  await player.load().catch(error => errors.push(error.code));
  const box = player.shadowRoot.querySelector('.message');
  return {errors, said: box.querySelector('p').textContent, hidden: box.hidden, code: player.error?.code, message: player.error?.message,
          states: [player.movie, player.readyState, player.networkState, player.paused]};
});
const notLoaded = '<l4d-player preload="none" src="scene.l4d"></l4d-player>';
const notFound = {errors: ['NOT_FOUND', 'NOT_FOUND'], hidden: false, code: 4, states: [null, 0, 3, true]};

for (const file of ['worker.js', 'sort-worker.js', 'l4d.wasm']) {
  test(`without ${file}: the player names it, fails, and loads once it is there`, async () => {
    server.faults.instead = {[file]: {status: 404, type: 'text/html'}};
    try {
      await withPage(notLoaded, async page => {
        const said = `${server.url}${file}: status 404; check the address`;
        assert.deepEqual(await failed(page), {...notFound, said, message: said});
        server.faults.instead = {};
        await page.click('.message button');
        await opened(page);
        assert.equal(await page.evaluate(() => document.querySelector('l4d-player').error), null);
      }, {errors: /404|MIME type/});
    } finally {
      server.faults.instead = {};
    }
  });
}

test('a page in place of a worker is a missing file, too; a policy that forbids workers is named', async () => {
  server.faults.instead = {'sort-worker.js': {status: 200, type: 'text/html'}};
  try {
    await withPage(notLoaded, async page => {
      const said = `${server.url}sort-worker.js: this is 'text/html' and no script; check the address`;
      assert.deepEqual(await failed(page), {...notFound, said, message: said});
    }, {errors: /MIME type/});
  } finally {
    server.faults.instead = {};
  }
  await withPage(notLoaded, async page => {
    const {errors, said, states} = await failed(page);
    assert.deepEqual([errors, states], [['INTERNAL', 'INTERNAL'], notFound.states]);
    assert.match(said, /worker.js did not start; a content security policy must allow it \(worker-src\)/);
  }, {headers: {'Content-Security-Policy': "worker-src 'none'"}, errors: /worker-src/});
});

test('opened as a file, the page of the player says what it needs, and so does a page with all of the player in it', async () => {
  const page = await newPage(browser);
  const folder = mkdtempSync(join(tmpdir(), 'l4d-'));
  try {
    await page.goto(pathToFileURL(join(root, 'build/web/player/index.html')).href);
    assert.match(await page.evaluate(() => document.body.innerText), /needs JavaScript, and a web server/);
    const script = readFileSync(join(root, 'build/web/l4dcodec-player/dist/l4d-player.js'), 'utf8').replaceAll('</script', '<\\/script');
    const path = join(folder, 'all.html');
    writeFileSync(path, `<!doctype html>${notLoaded}<script type="module">${script}</script>`);
    await page.goto(pathToFileURL(path).href);
    await page.waitForFunction(() => Boolean(customElements.get('l4d-player')));
    assert.match((await failed(page)).said, /opened as a file (starts no workers|reads no other files); put it on a web server/);
  } finally {
    await page.close();
    rmSync(folder, {recursive: true});
  }
});

test('pages that demand trusted types', () => withPage(playerOf, async page => {
  await opened(page);
  assert.ok(await page.evaluate(() => document.querySelector('l4d-player').isOpen));
}, {headers: {'Content-Security-Policy': "img-src data:; require-trusted-types-for 'script'; trusted-types l4dcodec; default-src 'none'; " +
  "script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; connect-src 'self'"}, errors: /requires 'TrustedScriptURL'|require-trusted-types-for/}));

test('the module on another origin: its workers start, and it finds l4d.wasm', async () => {
  const cdn = await serve({}, {}, 'build/web/player', {'Access-Control-Allow-Origin': '*'});
  try {
    await withPage(playerOf, async page => {
      await opened(page);
      assert.ok(await page.evaluate(() => document.querySelector('l4d-player').isOpen));
    }, {script: `${cdn.url}player.js`, headers: {'Content-Security-Policy':
      `default-src 'none'; img-src data:; script-src ${cdn.url} 'wasm-unsafe-eval'; worker-src blob: ${cdn.url}; connect-src 'self' ${cdn.url}`}});
  } finally {
    cdn.close();
  }
});

test('Escape in the menu gives the focus back to its button', () => withPage(playerOf, async page => {
  await opened(page);
  await page.click('.settings');
  await page.keyboard.press('Escape');
  assert.equal(await page.evaluate(() => document.querySelector('l4d-player').shadowRoot.activeElement?.className), 'settings');
}));
