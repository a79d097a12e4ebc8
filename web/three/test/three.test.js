// SPDX-License-Identifier: Apache-2.0
// The example of the adapter to three.js, in Chromium: its page is the test.
import assert from 'node:assert/strict';
import {readFileSync} from 'node:fs';
import {join} from 'node:path';
import {after, before, test} from 'node:test';
import {complaints, launch, root, serve, work} from '../../test/browser.js';
import {checkDisposal, checkHiding, fidelities, madeCameras, openExample, rendered} from '../../test/engine-page.js';

const stream = join(work, 'short.l4d');
const leastDb = 55;
/** @type {any} */
let browser, server, page;
before(async () => {
  browser = await launch();
  server = await serve({'scene.l4d': stream}, {}, 'build/web/three');
  page = await openExample(browser, server.url);
});
after(async () => {
  await browser?.close();
  server?.close();
});

/** @param {Record<string, string>} files @param {string} query @param {string} stream @param {[number, number][]} views */
const compare = async (files, query, stream, views) => {
  const other = await serve(files, {}, 'build/web/three');
  const second = await openExample(browser, `${other.url}${query}`);
  try {
    const found = await fidelities(second, stream, views, 'three.js');
    assert.ok(Math.min(...found) >= leastDb, found.join(' '));
  } finally {
    await second.close();
    other.close();
  }
};

test(`three.js shows what l4dcodec render draws, at ${leastDb} dB`, async () => {
  const found = await fidelities(page, stream, [[0.2, 0], [1.5, 1], [3, 2]], 'three.js');
  assert.ok(Math.min(...found) >= leastDb, found.join(' '));
});

test('flat windows, and how a stream wants to be drawn', async () => {
  for (const name of ['frames', 'drawn']) {
    const file = join(work, `${name}.l4d`);
    await compare({'scene.l4d': file}, '', file, [[0, 0], [7 / 30, 1], [0.99, 2]]);
  }
});

test('streams that follow each other, whose colours have other degrees', async () => {
  const joined = join(work, 'joined.l4d');
  await compare({'joined.m3u8': join(work, 'joined.m3u8'), 'joined.l4d': joined}, '?src=joined.m3u8', joined, [[0.5, 0], [1.01, 0], [3, 1], [0.2, 2]]);
});

test('a mesh hides splats behind it, and splats hide a mesh behind them', () => checkHiding(page));

/** In the page, at 1.5 s: PSNR of what `how` draws. @param {string} how @param {any} seen camera */
const drawn = async (how, seen) => page.evaluate(async ({camera, png, how}) => {
  const {tools, example: {THREE, camera: eye, splats, renderer}} = /** @type {any} */ (globalThis);
  tools.show(true, false);
  tools.look(camera, 320, 240);
  await tools.seek(1.5);
  if (how === 'moved') {
    // Scene and camera alike.
    splats.position.set(3, -2, 5);
    splats.rotation.set(0.4, 1, -2);
    splats.scale.setScalar(2.5);
    splats.updateMatrix();
    const {position, quaternion} = eye;
    position.applyMatrix4(splats.matrix);
    quaternion.premultiply(splats.quaternion);
  }
  const {formats} = splats.splats.painter;
  if (how === 'direct') formats.set(tools.gl, null);
  let target = null;
  if (how === 'linear') target = new THREE.WebGLRenderTarget(320, 240, {type: THREE.HalfFloatType, samples: 4});
  const pixels = await tools.picture(null, target);
  if (target) {
    for (let k = 0; k < pixels.length; ++k) pixels[k] = 255 * new THREE.Color().setRGB(pixels[k] / 255, 0, 0).convertLinearToSRGB().r;
    target.dispose();
  }
  formats.delete(tools.gl);
  splats.position.set(0, 0, 0);
  splats.rotation.set(0, 0, 0);
  splats.scale.setScalar(1);
  return tools.psnr(pixels, png);
}, {camera: seen, png: rendered(stream, seen, 1.5, [320, 240]), how});

test('the matrix of the object, a target of linear light with samples, and one whose depth cannot be copied', async () => {
  // What shines through splats blends in linear light there, as that of other transparent objects does.
  for (const [how, camera, least] of [['moved', madeCameras[1], leastDb], ['linear', madeCameras[2], 37], ['direct', madeCameras[1], 45]]) {
    const found = await drawn(how, camera);
    console.log(`${how}: ${found.toFixed(2)} dB`);
    assert.ok(found >= least, `${how}: ${found}`);
  }
});

test('the state that three.js remembers stays as it is', async () => {
  for (const isSet of [true, false]) {
    const {names, changed} = await page.evaluate(async isSet => {
      const {tools: {gl, draw}, example: {splats: {splats}}} = /** @type {any} */ (globalThis);
      const names = Object.keys(WebGL2RenderingContext).filter(name =>
        /_BINDING|_MASK$|WRITEMASK|^UNPACK_(A|F|P|R|S|I)|^ACTIVE_TEXTURE$|PROGRAM$|^BLEND_|VIEWPORT|SCISSOR_BOX|CLEAR_VALUE|FUNC$|_TEST$|^BLEND$|CULL_FACE$/.test(name) &&
        !/ATTRIB|COMPARE|BLOCK/.test(name));
      const state = () => names.map(name => gl.getParameter(gl[name]));
      const equal = (a, b) => a === b || (ArrayBuffer.isView(a) || Array.isArray(a)) && a.every((v, k) => v === b[k]);
      let changed = null;
      splats.draw = (context, view, views) => {
        gl.enable(gl.STENCIL_TEST);
        gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, true);
        if (!isSet) gl.blendFunc(gl.ZERO, gl.DST_COLOR);
        const before = state();
        Object.getPrototypeOf(splats).draw.call(splats, context, {...view, isSet}, views);
        const after = state();
        changed = names.filter((_, k) => !equal(before[k], after[k]));
        gl.disable(gl.STENCIL_TEST);
        gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, false);
        if (!isSet) gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
      };
      draw();
      delete splats.draw;
      return {names: names.length, changed};
    }, isSet);
    assert.ok(names > 50, `${names}`);
    assert.deepEqual(changed, []);
  }
});

test('a context that is lost and restored', async () => {
  const {png, camera} = {png: rendered(stream, madeCameras[1], 1.5, [320, 240]), camera: madeCameras[1]};
  const found = await page.evaluate(async ({png, camera}) => {
    const {tools, until, example: {splats: {splats}}} = /** @type {any} */ (globalThis);
    const {rows} = splats.stats;
    const extension = tools.gl.getExtension('WEBGL_lose_context');
    for (const name of ['lost', 'restored']) {
      const done = new Promise(resolve => tools.gl.canvas.addEventListener(`webglcontext${name}`, resolve, {once: true}));
      await new Promise(resolve => setTimeout(resolve));
      if (name === 'lost') extension.loseContext();
      else extension.restoreContext();
      await done;
    }
    await until(() => splats.stats.rows === rows, 'all rows');
    tools.look(camera, 320, 240);
    return tools.psnr(await tools.picture(), png);
  }, {png, camera});
  assert.ok(found >= leastDb, `${found}`);
});

/** What the tool knows of a camera that looks along -z. @param {{view: number[], projection: number[], size: [number, number]}} eye */
const cameraOf = ({view: v, projection: p, size: [width, height]}) => ({
  K: [[p[0] * width / 2, 0, width / 2 * (1 - p[8])], [0, p[5] * height / 2, height / 2 * (1 + p[9])], [0, 0, 1]],
  w2c: [0, 1, 2, 3].map(r => [0, 1, 2, 3].map(c => v[4 * c + r] * (r === 1 || r === 2 ? -1 : 1)))
});

test('both eyes of a headset, which have one order', async () => {
  const emulator = readFileSync(join(root, 'web/node_modules/iwer/build/iwer.min.js'));
  const second = await openExample(browser, server.url, undefined, `${emulator}
    globalThis.headset = new IWER.XRDevice(IWER.metaQuest3, {stereoEnabled: true, ipd: 0.5});
    headset.installRuntime({forceInstall: true});`);
  try {
    const {eyes, sorts, mesh} = await second.evaluate(async camera => {
      const {tools, headset, until, example} = /** @type {any} */ (globalThis);
      const {camera: head, movie, renderer: {xr}, renderer, splats: {splats}, draw} = example;
      tools.show(true, false);
      tools.look(camera, 320, 240);
      headset.position.copy(head.position);
      headset.quaternion.copy(head.quaternion);
      const {sorter} = splats, post = sorter.postMessage.bind(sorter);
      const sorts = [];  // of each picture
      sorter.postMessage = (...given) => {
        if (given[0].type === 'sort') ++sorts[sorts.length - 1];
        post(...given);
      };
      renderer.setAnimationLoop(() => {
        sorts.push(0);
        draw();
        if (!tools.take || tools.isShown && splats.drawn !== splats.wanted) return;
        tools.take(xr.getCamera().cameras.map(({viewport: {x, y, width, height}}) => {
          const pixels = new Uint8Array(4 * width * height);
          tools.gl.readPixels(x, y, width, height, tools.gl.RGBA, tools.gl.UNSIGNED_BYTE, pixels);
          return pixels;
        }));
      });
      const picture = () => new Promise(resolve => { tools.take = resolve; });
      await xr.setSession(await /** @type {any} */ (navigator).xr.requestSession('immersive-vr', {optionalFeatures: ['local-floor']}));
      movie.play();
      await until(() => movie.currentTime > 0.5, 'the movie');
      movie.pause();
      await tools.seek(1.5);
      tools.eyes = await picture();
      // A mesh before all splats.
      tools.mesh = [];
      example.mesh.position.set(5.5, -1.5, 3.2);
      example.mesh.scale.setScalar(0.3);
      for (const hasSplats of [false, true]) {
        tools.show(hasSplats, true);
        for (const pixels of await picture()) {
          let green = 0;
          for (let k = 0; k < pixels.length; k += 4) green += pixels[k] === 0 && pixels[k + 1] === 255 && pixels[k + 2] === 0 ? 1 : 0;
          tools.mesh.push(green);
        }
      }
      const eyes = xr.getCamera().cameras.map(({matrixWorldInverse, projectionMatrix, viewport: {width, height}}) => (
        {view: matrixWorldInverse.elements, projection: projectionMatrix.elements, size: [width, height]}));
      return {eyes, sorts, mesh: tools.mesh};
    }, madeCameras[1]);
    assert.ok(sorts.length > 5 && Math.max(...sorts) === 1, `${sorts}`);
    assert.ok(Math.min(...mesh) > 100 && mesh[0] === mesh[2] && mesh[1] === mesh[3], `the mesh in both eyes, without and with splats: ${mesh}`);
    const found = [];
    for (const [k, eye] of eyes.entries()) {
      const png = rendered(stream, cameraOf(eye), 1.5, eye.size);
      found.push(await second.evaluate(({k, png}) => /** @type {any} */ (globalThis).tools.psnr(/** @type {any} */ (globalThis).tools.eyes[k], png), {k, png}));
    }
    console.log(`both eyes: ${found.map(v => v.toFixed(2)).join(', ')} dB, of ${sorts.length} pictures`);
    assert.ok(found.length === 2 && Math.min(...found) >= leastDb, found.join(' '));
    assert.deepEqual(await complaints(second), []);
  } finally {
    await second.close();
  }
});

test('a movie that is given stays the caller\'s, and tells when there is something new', async () => {
  const camera = madeCameras[1];
  const found = await page.evaluate(async ({camera, png}) => {
    const {tools, until, example: {L4DSplats, movie, scene, splats}} = /** @type {any} */ (globalThis);
    const other = new L4DSplats(movie);
    let changes = 0;
    other.onchange = () => ++changes;
    tools.show(false, false);
    scene.add(other);
    await other.load();
    tools.look(camera, 320, 240);
    await tools.seek(1.5);
    tools.draw();
    await until(() => other.splats.stats.rows === splats.splats.stats.rows, 'all rows');
    do {
      const before = changes;
      tools.draw();
      if (other.splats.drawn !== other.splats.wanted) await until(() => changes > before, 'an order');
    } while (other.splats.drawn !== other.splats.wanted);
    const psnr = await tools.psnr(tools.pixels(), png);
    other.dispose();
    return {psnr, isLeft: scene.children.includes(other), isOpen: !movie.disposed};
  }, {camera, png: rendered(stream, camera, 1.5, [320, 240])});
  assert.ok(found.psnr >= leastDb, `${found.psnr}`);
  assert.deepEqual([found.isLeft, found.isOpen], [false, true]);
});

test('what is disposed of is gone, with its workers', () => checkDisposal(page));
