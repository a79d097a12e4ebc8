// SPDX-License-Identifier: Apache-2.0
// For programs that drive the examples of adapters: cameras, the tool's pictures, and what runs in an example's page.
import assert from 'node:assert/strict';
import {execFileSync} from 'node:child_process';
import {readFileSync, writeFileSync} from 'node:fs';
import {join} from 'node:path';
import {after, before, test} from 'node:test';
import {complaints, launch, newPage, serve, work} from './browser.js';

export const tool = /** @type {string} */ (process.env.L4D_TOOL);

/** Of the scenes that `synth` makes, 320x240, y down. */
export const madeCameras = [
  {eye: [0, -1, -9], target: [0, 0, 0], focal: 280}, {eye: [7, -2, 4], target: [0, 0, 0], focal: 280},
  {eye: [0.5, 0, -2], target: [0, 0, 1], focal: 200}
].map(({eye, target, focal}) => {
  const unit = v => v.map(c => c / Math.hypot(...v));
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const forward = unit(target.map((t, k) => t - eye[k]));
  const right = unit(cross(forward, [0, -1, 0]));
  const rows = [right, cross(forward, right), forward].map(a => [...a, -a.reduce((s, c, k) => s + c * eye[k], 0)]);
  return {K: [[focal, 0, 160], [0, focal, 120], [0, 0, 1]], w2c: [...rows, [0, 0, 0, 1]]};
});

/**
 * PNG of the tool.
 * @param {string} stream path @param {any} camera K and w2c @param {number} time @param {[number, number]} size
 * @returns {string} base64
 */
export const rendered = (stream, camera, time, [width, height]) => {
  // Tests of several engines run at once.
  const name = join(work, `engine.${process.pid}`), cameras = `${name}.json`, png = `${name}.png`;
  writeFileSync(cameras, JSON.stringify({fps: 30, width, height, frames: 150, cameras: [{id: 0, split: 'test', ...camera}]}));
  execFileSync(tool, ['render', stream, '--cameras', cameras, '--camera', '0', '--time', String(time), '-q', '-f', '-o', png]);
  return readFileSync(png).toString('base64');
};

/**
 * The example with a stream, which draws on request.
 * @param {any} browser @param {string} url @param {() => void} [engine] in the page: makes `tools`, what its engine does its own way
 * @param {string} [script] that runs before
 */
export const openExample = async (browser, url, engine = threeTools, script = '') => {
  const page = await newPage(browser, {viewport: {width: 320, height: 240}});
  await page.addInitScript(script);
  await page.goto(url, {waitUntil: 'commit', timeout: 120000});
  await page.waitForFunction(() => 'example' in globalThis, undefined, {timeout: 120000});
  await page.evaluate(engine);
  await page.evaluate(install);
  return page;
};

/**
 * PSNR of instants in an example against `l4dcodec render`.
 * @param {any} page @param {string} stream @param {[number, number][]} views times and cameras @param {string} name of what draws
 */
export const fidelities = async (page, stream, views, name) => {
  const found = [];
  for (const [time, k] of views) {
    const camera = madeCameras[k];
    found.push(await page.evaluate(async ({camera, time, png}) => {
      const {tools} = /** @type {any} */ (globalThis);
      tools.show(true, false);
      tools.look(camera, 320, 240);
      await tools.seek(time);
      return tools.psnr(await tools.picture(), png);
    }, {camera, time, png: rendered(stream, camera, time, [320, 240])}));
  }
  console.log(`${name} against l4dcodec render: ${found.map(v => v.toFixed(2)).join(', ')} dB`);
  assert.deepEqual(await complaints(page), []);
  return found;
};

/** A mesh before, within and behind splats: what is nearer hides the other. @param {any} page */
export const checkHiding = async page => {
  const found = await page.evaluate(async camera => {
    const {tools} = /** @type {any} */ (globalThis);
    tools.look(camera, 320, 240);
    await tools.seek(1);
    // Pixels of the mesh's colour alone, without and with splats.
    const green = async (z, scale) => {
      tools.place(z, scale);
      const counts = [];
      for (const hasSplats of [false, true]) {
        tools.show(hasSplats, true);
        const pixels = await tools.picture();
        let count = 0;
        for (let k = 0; k < pixels.length; k += 4) count += pixels[k] === 0 && pixels[k + 1] === 255 && pixels[k + 2] === 0 ? 1 : 0;
        counts.push(count);
      }
      return counts;
    };
    return {before: await green(-6, 0.6), within: await green(-1.5, 1.8), behind: await green(9, 4)};
  }, madeCameras[0]);
  console.log(`pixels of the mesh alone, without and with splats: ${JSON.stringify(found)}`);
  for (const [alone] of Object.values(found)) assert.ok(alone > 1000, 'the mesh is in the picture');
  assert.equal(found.before[1], found.before[0], 'nothing hides it');
  assert.ok(found.within[1] > 0 && found.within[1] < 0.9 * found.within[0], 'splats hide a part');
  assert.ok(found.behind[1] < 0.1 * found.behind[0], 'splats hide it');
};

/** Frees what it has, and nothing of it is seen. @param {any} page */
export const checkDisposal = async page => {
  const {lit, isThere} = await page.evaluate(async () => {
    const {tools: {gl, show, draw, pixels}, example: {splats}} = /** @type {any} */ (globalThis);
    const {rows} = splats.splats.painter.store;
    show(true, false);
    (splats.destroy ?? splats.dispose).call(splats);
    draw();
    return {lit: pixels().reduce((sum, v, k) => sum + (k % 4 === 3 ? 0 : v), 0), isThere: gl.isTexture(rows)};
  });
  assert.equal(lit, 0);
  assert.equal(isThere, false);
  // Either of two workers may be the first to end.
  for (const end = Date.now() + 60000; page.workers().length !== 0;) {
    assert.ok(Date.now() < end, 'workers end');
    await new Promise(resolve => setTimeout(resolve, 20));
  }
  assert.deepEqual(await complaints(page), []);
};

/**
 * Tests of an adapter that has what is its own in its engine alone.
 * @param {string} folder of its page @param {string} name @param {() => void} engine in the page: what it does its own way
 */
export const testEngine = (folder, name, engine) => {
  const stream = join(work, 'short.l4d');
  const leastDb = 55;
  /** @type {any} */
  let browser, server, page;
  before(async () => {
    browser = await launch();
    server = await serve({'scene.l4d': stream}, {}, `build/web/${folder}`);
    page = await openExample(browser, server.url, engine);
  });
  after(async () => {
    await browser?.close();
    server?.close();
  });
  test(`${name} shows what l4dcodec render draws, at ${leastDb} dB`, async () => {
    const found = await fidelities(page, stream, [[0.2, 0], [1.5, 1], [3, 2]], name);
    assert.ok(Math.min(...found) >= leastDb, found.join(' '));
  });
  test('a mesh hides splats behind it, and splats hide a mesh behind them', () => checkHiding(page));
  test('what is disposed of is gone, with its workers', () => checkDisposal(page));
};

/** In the page: what three.js does its own way. */
function threeTools() {
  const {THREE, renderer, camera, controls, scene, mesh, splats} = /** @type {any} */ (globalThis).example;
  renderer.setAnimationLoop(null);
  controls.enabled = false;
  const tools = {
    gl: renderer.getContext(),
    /** A camera of K and w2c, at a size. */
    look({K, w2c}, width, height) {
      renderer.setPixelRatio(1);
      renderer.setSize(width, height, false);
      const flip = new THREE.Matrix4().makeScale(1, -1, -1);
      const m = flip.multiply(new THREE.Matrix4().set(...w2c.flat())).invert();
      m.decompose(camera.position, camera.quaternion, camera.scale);
      camera.projectionMatrix.fromArray(tools.projection(K, width, height, camera.near, camera.far));
      camera.projectionMatrixInverse.copy(camera.projectionMatrix).invert();
    },
    /** In the axes of the stream. */
    show(hasSplats, hasMesh) {
      splats.rotation.x = 0;
      splats.visible = hasSplats;
      mesh.visible = hasMesh;
    },
    place(z, scale) {
      mesh.position.set(0, -0.5, z);
      mesh.scale.setScalar(scale);
    },
    draw(target = null) {
      renderer.setRenderTarget(target);
      renderer.render(scene, camera);
    },
    /** Of a target of 16-bit floats, of 255. */
    read(target) {
      const {width, height} = target;
      const halves = new Uint16Array(4 * width * height);
      renderer.readRenderTargetPixels(target, 0, 0, width, height, halves);
      renderer.setRenderTarget(null);
      return Float32Array.from(halves, h => 255 * THREE.DataUtils.fromHalfFloat(h));
    }
  };
  Object.assign(globalThis, {tools});
}

/** In the page: functions that tests call. */
function install() {
  const {tools, example} = /** @type {any} */ (globalThis);
  const {movie} = example;
  const {show} = tools;
  const pause = () => new Promise(resolve => setTimeout(resolve, 5));
  Object.assign(tools, {
    isShown: true,
    show(hasSplats, hasMesh) {
      tools.isShown = hasSplats;
      show(hasSplats, hasMesh);
    },
    /** [4, 4] by columns, of a camera that looks along -z. */
    projection(K, width, height, near, far) {
      return [2 * K[0][0] / width, 0, 0, 0, 0, 2 * K[1][1] / height, 0, 0, 1 - 2 * K[0][2] / width, 2 * K[1][2] / height - 1,
              -(far + near) / (far - near), -1, 0, 0, -2 * far * near / (far - near), 0];
    },
    /** All of an instant, with its details. */
    async seek(time) {
      await movie.seek(time);
      while (movie.ready.detail !== 'full') await pause();
    },
    /** Pixels of the canvas or of a target, the lowest line first, once all is sorted. */
    async picture(spark = example.spark, target = null) {
      const sorted = example.splats.splats;
      const isBusy = () => spark ? spark.sorting || spark.sortDirty : tools.isShown && sorted.drawn !== sorted.wanted;
      // Spark asks for an order after it has drawn, and shows it in a later picture; others are done when a picture shows it.
      for (let k = spark ? 0 : 1; k < 2; ++k) {
        tools.draw(target);
        do {
          await pause();
          if (!spark) tools.draw(target);
        } while (isBusy());
      }
      tools.draw(target);
      return target ? tools.read(target) : tools.pixels();
    },
    /** Of the canvas: an engine may leave another framebuffer bound. */
    pixels() {
      const {gl} = tools;
      const bound = gl.getParameter(gl.READ_FRAMEBUFFER_BINDING);
      const bytes = new Uint8Array(4 * gl.canvas.width * gl.canvas.height);
      gl.bindFramebuffer(gl.READ_FRAMEBUFFER, null);
      gl.readPixels(0, 0, gl.canvas.width, gl.canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
      gl.bindFramebuffer(gl.READ_FRAMEBUFFER, bound);
      return bytes;
    },
    /** PSNR of pixels against a PNG. */
    async psnr(pixels, png) {
      const bitmap = await createImageBitmap(await (await fetch(`data:image/png;base64,${png}`)).blob());
      const {width, height} = bitmap;
      const context = /** @type {any} */ (new OffscreenCanvas(width, height).getContext('2d'));
      context.drawImage(bitmap, 0, 0);
      const wanted = context.getImageData(0, 0, width, height).data;
      let sum = 0;
      for (let y = 0; y < height; ++y) {
        for (let k = 0; k < 4 * width; ++k) {
          if (k % 4 === 3) continue;
          const value = Math.round(Math.min(pixels[4 * width * (height - 1 - y) + k], 255));
          sum += (value - wanted[4 * width * y + k]) ** 2;
        }
      }
      return 10 * Math.log10(255 ** 2 / (sum / (3 * width * height)));
    }
  });
}
