// SPDX-License-Identifier: Apache-2.0
// Where the camera of <l4d-player> looks, by attributes, fingers and a point that is clicked.
import assert from 'node:assert/strict';
import {test} from 'node:test';
import {opened} from './browser.js';
import {pagesWith} from './pages.js';

const withPage = pagesWith('short', 'drawn');

/**
 * A page with one player, once it shows its first picture. @param {string} attributes
 * @param {(page: any) => Promise<void>} fn @param {any} [options] of pageWith()
 */
const withPlayer = (attributes, fn, options) => withPage(`<l4d-player ${attributes}></l4d-player>`, async page => {
  await opened(page);
  await page.evaluate(() => {
    globalThis.player = document.querySelector('l4d-player');
    globalThis.sources = [];
    player.addEventListener('camera-change', ({detail}) => globalThis.sources.push(detail.source));
  });
  await fn(page);
}, options);

/** Angles in degrees. @param {any} page */
const orbit = page => page.evaluate(() => {
  const {theta, phi, radius} = player.getCameraOrbit();
  return [theta * 180 / Math.PI, phi * 180 / Math.PI, radius, player.getFieldOfView(), ...Object.values(player.getCameraTarget()).slice(0, 3)];
});
/** @param {number[]} a @param {number[]} b */
const near = (a, b, least = 1e-3) => assert.ok(b.every((v, k) => Math.abs(a[k] - v) < least), `${a}, not ${b}`);
/** Until nothing moves the camera. @param {any} page */
const settled = page => page.waitForFunction(() => !player.aim.goal, undefined, {timeout: 60000});

test('attributes say where the camera is, and it moves to where they say', () => withPlayer(
  'src="drawn.l4d" camera-orbit="30deg 75deg 4m" camera-target="0.5 0.25 0m" field-of-view="40deg"', async page => {
    // The scene says how many metres a unit has: half of one.
    near(await orbit(page), [30, 75, 8, 40, 0.5, 0.25, 0]);
    const found = await page.evaluate(() => {
      const {orbit, canvas} = player.view;
      const {worldToCamera: m, fy} = player.view.camera();
      const eye = orbit.eye().map((v, k) => v - orbit.target[k]);
      const level = Math.sin(75 * Math.PI / 180);
      // To the right of the first view, and above.
      orbit.restore({...orbit.home, yaw: 0, pitch: 0});
      const [right] = orbit.axes();
      const sum = (a, b) => a.reduce((total, v, k) => total + v * b[k], 0);
      return {up: sum(eye, orbit.up) / 8, right: sum(eye, right) / 8 / level, fov: 2 * Math.atan(canvas.height / 2 / fy) * 180 / Math.PI, m: m.length};
    });
    near([found.up, found.right, found.fov], [Math.cos(75 * Math.PI / 180), 0.5, 40]);
    await page.evaluate(async () => {
      await player.home();
      globalThis.way = [];
      player.addEventListener('camera-change', () => globalThis.way.push(player.getCameraOrbit().radius));
      globalThis.sources.length = 0;
      player.cameraOrbit = '350deg 1rad 200%';
      player.cameraTarget = '0 0 0';
      player.fieldOfView = '30';
    });
    await settled(page);
    const home = await page.evaluate(() => player.view.orbit.home.distance);
    near(await orbit(page), [350, 180 / Math.PI, 2 * home, 30, 0, 0, 0]);
    const [way, sources, text] = await page.evaluate(async () => {
      await player.view.settled();
      return [globalThis.way, globalThis.sources, String(player.getCameraOrbit())];
    });
    assert.ok(way.some(radius => radius > 8.01 && radius < 2 * home - 0.01), `${way}`);
    assert.ok(sources.length > 1 && sources.every(source => source === 'none'), `${sources}`);
    // What is said of now is what attributes take.
    await page.evaluate(text => { player.cameraOrbit = text; }, text);
    await settled(page);
    near(await orbit(page), [350, 180 / Math.PI, 2 * home]);
    // Without them, or with a wrong one, it is what the stream suggests.
    await page.evaluate(() => {
      for (const name of ['cameraOrbit', 'fieldOfView']) player[name] = null;
      player.cameraTarget = 'somewhere';
    });
    await settled(page);
    near(await orbit(page), [...await page.evaluate(() => {
      const {home} = player.view.orbit;
      return [-home.yaw * 180 / Math.PI, 90 - home.pitch * 180 / Math.PI, home.distance, 40, ...home.target];
    })]);
  }));

test('fingers, the wheel and keys stay within the limits', () => withPlayer(
  `src="short.l4d" camera-orbit="0 80deg 9" min-camera-orbit="-20deg 60deg 6" max-camera-orbit="10deg 85deg 12"
  min-field-of-view="30deg" max-field-of-view="50deg"`, async page => {
    near(await orbit(page), [0, 80, 9, 50]);
    const press = async (key, count) => { for (let k = 0; k < count; ++k) await page.keyboard.press(key); };
    await page.locator('l4d-player canvas').focus();
    await press('Alt+ArrowLeft', 6);
    await press('Alt+ArrowUp', 8);
    await press('+', 8);
    await press('Alt+=', 10);
    near(await orbit(page), [10, 60, 6, 30]);
    await page.mouse.move(100, 100);
    await page.mouse.down();
    await page.mouse.move(300, 30, {steps: 3});
    await page.mouse.up();
    await page.mouse.wheel(0, 900);
    await page.waitForFunction(() => player.getCameraOrbit().radius >= 12);
    near(await orbit(page), [-20, 85, 12, 30]);
    const sources = await page.evaluate(async () => {
      await player.view.settled();
      return globalThis.sources;
    });
    assert.ok(sources.length > 2 && sources.every(source => source === 'user-interaction'), `${sources}`);
    // A narrower limit moves the camera, and so does a wider view.
    await page.evaluate(() => { player.maxCameraOrbit = 'auto 70deg 8'; });
    await settled(page);
    near(await orbit(page), [-20, 70, 8, 30]);
    await page.evaluate(() => { player.fieldOfView = '90deg'; });
    await settled(page);
    near(await orbit(page), [-20, 70, 8, 50]);
  }));

test('it turns by itself until it is touched', async () => {
  const turned = (page, from) => page.waitForFunction(from => Math.abs(player.getCameraOrbit().theta - from) > 0.02, from, {timeout: 60000});
  await withPlayer('src="short.l4d" auto-rotate auto-rotate-delay="50" rotation-per-second="1rad"', async page => {
    const [first] = await orbit(page);
    await turned(page, first * Math.PI / 180);
    assert.ok((await page.evaluate(() => globalThis.sources)).every(source => source === 'automatic'));
    const stopped = await page.evaluate(async () => {
      const {aim} = player;
      const before = aim.isTurning;
      // With this delay, it does not begin again soon.
      player.getAttribute = name => name === 'auto-rotate-delay' ? '600000' : HTMLElement.prototype.getAttribute.call(player, name);
      player.shadowRoot.querySelector('canvas').dispatchEvent(new KeyboardEvent('keydown', {key: '+', bubbles: true, composed: true}));
      const {theta} = player.getCameraOrbit();
      await new Promise(resolve => setTimeout(resolve, 300));
      return [before, aim.isTurning, player.getCameraOrbit().theta - theta];
    });
    assert.deepEqual(stopped, [true, false, 0]);
  });
  await withPlayer('src="short.l4d" auto-rotate auto-rotate-delay="0"', async page => {
    const before = await orbit(page);
    await page.waitForTimeout(300);
    assert.deepEqual(await orbit(page), before);
    // What the page wants is there at once.
    await page.evaluate(() => { player.cameraOrbit = '20deg 70deg 5'; });
    near(await orbit(page), [20, 70, 5]);
  }, {options: {reducedMotion: 'reduce'}});
});

/** A point of the window where a Gaussian is seen that nothing hides, and where that Gaussian is. @param {any} page */
const visible = page => page.evaluate(async () => {
  const {view, movie} = player;
  movie.pause();
  await movie.seek(1);
  await view.settled();
  const {position, opacity, count} = await movie.slice(1);
  const {worldToCamera: m, fx, fy, cx, cy} = view.camera();
  let best = null;
  for (let k = 0; k < count; ++k) {
    const p = [...position.subarray(3 * k, 3 * k + 3)];
    const [x, y, z] = [0, 4, 8].map(r => m[r] * p[0] + m[r + 1] * p[1] + m[r + 2] * p[2] + m[r + 3]);
    const at = {x: cx + fx * x / z, y: cy + fy * y / z};
    const isAside = Math.abs(at.x - cx) > 40 && Math.abs(at.x - cx) < 120 && Math.abs(at.y - cy) < 60;
    if (z > 0 && opacity[k] > 0.8 && isAside && !(best?.depth < z)) best = {...at, depth: z, position: p};
  }
  const box = view.canvas.getBoundingClientRect();
  // A mouse points at whole pixels.
  return {...best, x: Math.round(box.left + best.x * box.width / view.canvas.width), y: Math.round(box.top + best.y * box.height / view.canvas.height)};
});

test('a point of the picture has a position, and a double click looks there', () => withPlayer('src="short.l4d"', async page => {
  const {x, y, position} = await visible(page);
  const [found, nothing, outside] = await page.evaluate(async ([x, y]) => [
    await player.queryPosition(x, y), await player.queryPosition(9, 9), await player.queryPosition(-5, 5)], [x, y]);
  const depth = await page.evaluate(([x, y, z]) => {
    const {worldToCamera: m} = player.view.camera();
    return m[8] * x + m[9] * y + m[10] * z + m[11];
  }, found);
  near(found, position, 0.05 * depth);
  assert.deepEqual([nothing, outside], [null, null]);
  const before = await orbit(page);
  await page.mouse.dblclick(x, y);
  await page.waitForFunction(x => Math.abs(player.view.orbit.target[0] - x) < 1e-6 && !player.aim.goal, found[0], {timeout: 60000});
  near(await orbit(page), [before[0], before[1], depth, before[3], ...found], 1e-6);
  assert.ok((await page.evaluate(() => globalThis.sources)).every(source => source === 'user-interaction'));
  // Neither of its clicks has played.
  await page.waitForTimeout(400);
  assert.deepEqual(await page.evaluate(() => [player.paused, player.currentTime]), [true, 1]);
  // Flying, the eye stays.
  const eye = await page.evaluate(async () => {
    await player.home();
    await player.view.settled();
    player.setAttribute('camera', 'fly');
    return player.view.orbit.eye();
  });
  const ahead = await page.evaluate(async ([x, y]) => {
    const point = await player.queryPosition(x, y);
    await player.lookAtPoint(x, y);
    return point;
  }, [x, y]);
  await settled(page);
  near(await page.evaluate(() => player.view.orbit.eye()), eye, 1e-6);
  near((await orbit(page)).slice(4), ahead, 1e-6);
}));

test('toBlob() is what is shown, at any size', () => withPlayer('src="short.l4d"', async page => {
  const found = await page.evaluate(async () => {
    const read = async blob => {
      const bitmap = await createImageBitmap(blob);
      const {width, height} = bitmap;
      const context = Object.assign(document.createElement('canvas'), {width, height}).getContext('2d');
      context.drawImage(bitmap, 0, 0);
      const {data} = context.getImageData(0, 0, width, height);
      return {type: blob.type, size: [width, height], data, light: data.reduce((a, b, k) => a + (k % 4 === 3 ? 0 : b), 0) / data.length};
    };
    const failure = options => player.toBlob(options).then(() => null, error => error.code);
    player.movie.pause();
    const {canvas} = player.view;
    const size = [canvas.width, canvas.height];
    const whole = await read(await player.toBlob());
    const pixels = await player.view.pixels();
    const small = await read(await player.toBlob({type: 'image/jpeg', quality: 0.7, width: 160}));
    const tall = await read(await player.toBlob({width: 200, height: 300}));
    const after = await player.view.pixels();
    const errors = [await failure({width: 0}), await failure({height: 2.5})];
    player.unload();
    return {whole: {...whole, data: null}, small: {...small, data: null}, tall: {...tall, data: null}, size, errors,
            same: whole.data.every((v, k) => v === pixels[k]), kept: after.every((v, k) => v === pixels[k]),
            now: [canvas.width, canvas.height], closed: await player.toBlob().catch(error => error.name)};
  });
  assert.deepEqual([found.whole.type, found.whole.size, found.same, found.kept, found.now], ['image/png', found.size, true, true, found.size]);
  assert.deepEqual([found.small.type, found.small.size], ['image/jpeg', [160, Math.round(160 * found.size[1] / found.size[0])]]);
  assert.deepEqual([found.tall.type, found.tall.size], ['image/png', [200, 300]]);
  for (const {light} of [found.whole, found.small]) assert.ok(light > 5 && Math.abs(light - found.whole.light) < 3, `${light}`);
  assert.ok(found.tall.light > 5, `${found.tall.light}`);
  assert.deepEqual([found.errors, found.closed], [['INVALID_ARGUMENT', 'INVALID_ARGUMENT'], 'InvalidStateError']);
}));
