// SPDX-License-Identifier: Apache-2.0
// For programs that drive the example: cameras, the tool's pictures, and what runs in the example's page.
import {execFileSync} from 'node:child_process';
import {readFileSync, writeFileSync} from 'node:fs';
import {join} from 'node:path';
import {newPage, work} from '../../test/browser.js';

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
  const cameras = join(work, 'spark.cameras.json'), png = join(work, 'spark.png');
  writeFileSync(cameras, JSON.stringify({fps: 30, width, height, frames: 150, cameras: [{id: 0, split: 'test', ...camera}]}));
  execFileSync(tool, ['render', stream, '--cameras', cameras, '--camera', '0', '--time', String(time), '-q', '-f', '-o', png]);
  return readFileSync(png).toString('base64');
};

/** The example with a stream, which draws on request. @param {any} browser @param {string} url */
export const openExample = async (browser, url) => {
  const page = await newPage(browser, {viewport: {width: 320, height: 240}});
  await page.goto(url, {waitUntil: 'commit', timeout: 120000});
  await page.waitForFunction(() => 'example' in globalThis, undefined, {timeout: 120000});
  await page.evaluate(install);
  return page;
};

/** In the page: functions that tests call. */
function install() {
  const {THREE, renderer, camera, controls, movie, scene} = /** @type {any} */ (globalThis).example;
  const pause = () => new Promise(resolve => setTimeout(resolve, 5));
  renderer.setAnimationLoop(null);
  controls.enabled = false;
  const tools = {
    /** A camera of K and w2c, at a size. */
    look({K, w2c}, width, height) {
      renderer.setPixelRatio(1);
      renderer.setSize(width, height, false);
      const flip = new THREE.Matrix4().makeScale(1, -1, -1);
      const m = flip.multiply(new THREE.Matrix4().set(...w2c.flat())).invert();
      m.decompose(camera.position, camera.quaternion, camera.scale);
      const [near, far] = [camera.near, camera.far];
      camera.projectionMatrix.set(2 * K[0][0] / width, 0, 1 - 2 * K[0][2] / width, 0,
                                  0, 2 * K[1][1] / height, 2 * K[1][2] / height - 1, 0,
                                  0, 0, -(far + near) / (far - near), -2 * far * near / (far - near), 0, 0, -1, 0);
      camera.projectionMatrixInverse.copy(camera.projectionMatrix).invert();
    },
    /** All of an instant, with its details. */
    async seek(time) {
      await movie.seek(time);
      while (movie.ready.detail !== 'full') await pause();
    },
    /** Pixels of the canvas or of a target of 16-bit floats, the lowest line first, once all is sorted. */
    async picture(spark = /** @type {any} */ (globalThis).example.spark, target = null) {
      const draw = () => {
        renderer.setRenderTarget(target);
        renderer.render(scene, camera);
      };
      for (let k = 0; k < 2; ++k) {
        draw();
        do await pause(); while (spark.sorting || spark.sortDirty);
      }
      draw();
      const gl = renderer.getContext();
      const {width, height} = target ?? gl.canvas;
      const halves = target && new Uint16Array(4 * width * height);
      const bytes = new Uint8Array(4 * width * height);
      if (halves) renderer.readRenderTargetPixels(target, 0, 0, width, height, halves);
      else gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
      renderer.setRenderTarget(null);
      return halves ? Float32Array.from(halves, h => 255 * THREE.DataUtils.fromHalfFloat(h)) : bytes;
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
  };
  Object.assign(globalThis, {tools});
}
