// SPDX-License-Identifier: Apache-2.0
// What a frame of made Gaussians costs, with either back end: for index.html, next to the packages.
import {OrbitCamera} from '../l4dcodec-player/src/camera.js';
import {Sorter} from '../l4dcodec-player/src/sorter.js';
import {GlSurface} from '../l4dcodec-player/src/surface.js';
import {GpuSurface} from '../l4dcodec-player/src/webgpu/surface.js';

const degree = 3;
const bucketRows = 65536;
const time = 1;
const streams = [{stream: 0, time, frame: 0}];

/** Numbers from 0 to 1, the same each time. */
const randomNumbers = () => {
  let state = 1;
  return () => {
    state = Math.imul(state ^ state >>> 15, 0x2c1b3c6d) + 0x9e3779b9 | 0;
    return ((state ^ state >>> 13) >>> 0) / 2 ** 32;
  };
};

/**
 * Rows of moving Gaussians in a ball of radius 1, all of them seen at `time`. They are the smaller the more there are, so
 * that a pixel is covered as often.
 * @param {number} count
 */
const makeRows = count => {
  const random = randomNumbers();
  const size = 0.6 / Math.cbrt(count);
  const stride = 3 * (degree + 1) ** 2;
  const buckets = [];
  for (let begin = 0; begin < count; begin += bucketRows) {
    const n = Math.min(bucketRows, count - begin);
    const geometry = new Float32Array(16 * n);
    const sh = new Uint16Array(stride * n);
    for (let k = 0; k < n; ++k) {
      const at = [2, 2, 2];
      while (Math.hypot(...at) > 1) for (let i = 0; i < 3; ++i) at[i] = 2 * random() - 1;
      const scales = [0, 1, 2].map(() => (size * (0.3 + 1.4 * random())) ** 2);
      geometry.set([...at, 0.1 + 0.9 * random(), 0.01 * random(), 0.01 * random(), 0, time,
                    scales[0], 0, 0, scales[1], 0, scales[2], random(), 0.2 * random()], 16 * k);
      // Binary16 of -0.5 to 0.5, or of less in the detail.
      for (let i = 0; i < stride; ++i) sh[stride * k + i] = random() * (i < 3 ? 0x3800 : 0x2c00) | (random() < 0.5 ? 0x8000 : 0);
    }
    buckets.push({key: String(begin), stream: 0, count: n, center: 0, shStride: stride, geometry, sh, detail: 0, bucket: null});
  }
  return buckets;
};

const median = values => [...values].sort((a, b) => a - b)[values.length >> 1];

/**
 * @param {HTMLCanvasElement} canvas a new one, of the size of the picture @param {'webgl2' | 'webgpu'} backend
 * @param {number} count of Gaussians @param {number} frames
 * @returns {Promise<{cpu: number, sort: number | null, frame: number, visible: number, device: string}>} ms: of the
 *   thread of the page for a frame; of another thread for an order; from frame to frame, when nothing else holds them up
 */
export const measure = async (canvas, backend, count, frames) => {
  const surface = backend === 'webgl2' ? new GlSurface(canvas) : await GpuSurface.create(canvas, true);
  const painter = surface.makePainter({maxRows: count + bucketRows, shDegree: degree, target: '16f'});
  const sorter = new Sorter();
  for (const rows of makeRows(count)) {
    const lines = painter.store.add(rows);
    if (!lines) throw new Error(`no room for ${count} Gaussians`);
    if (!painter.sorts) sorter.add(rows.key, rows.geometry, lines, rows.center, rows.stream);
  }
  const orbit = new OrbitCamera();
  orbit.distance = 2.6;
  const {width, height} = canvas;
  const cpu = [], sorts = [];
  let camera = orbit.camera(width, height), order = null;
  const sort = () => {
    const began = performance.now();
    const m = camera.worldToCamera;
    order = sorter.sort({streams, depth: [m[8], m[9], m[10], m[11]], nearPlane: camera.nearPlane}, order);
    sorts.push(performance.now() - began);
  };
  const draw = () => {
    orbit.orbit(0.01, 0);
    camera = orbit.camera(width, height);
    if (!painter.sorts && sorts.length === 0) sort();
    const began = performance.now();
    if (!painter.sorts) painter.setOrder(order, sorter.visible);
    painter.draw(camera, streams, width, height, [0, 0, 0]);
    cpu.push(performance.now() - began);
  };
  draw();
  await painter.finished();
  cpu.length = 0;
  const began = performance.now();
  for (let k = 0; k < frames; ++k) draw();
  await painter.finished();
  const frame = (performance.now() - began) / frames;
  if (!painter.sorts) for (let k = 0; k < 5; ++k) sort();
  const visible = painter.count;
  const info = surface.backend === 'webgl2' ? surface.gl.getExtension('WEBGL_debug_renderer_info') : null;
  const device = info ? surface.gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : '';
  painter.dispose();
  surface.dispose();
  return {cpu: median(cpu), sort: painter.sorts ? null : median(sorts), frame, visible, device};
};
