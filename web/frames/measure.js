// SPDX-License-Identifier: Apache-2.0
// What a frame of made Gaussians costs, with either back end: for index.html, next to the packages.
import {OrbitCamera} from '../l4dcodec-player/src/camera.js';
import {Sorter} from '../l4dcodec-player/src/sorter.js';
import {GlSurface} from '../l4dcodec-player/src/surface.js';
import {GpuSurface} from '../l4dcodec-player/src/webgpu/surface.js';
import {bucketRows, degree, makeRows, median, streams} from './rows.js';

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
