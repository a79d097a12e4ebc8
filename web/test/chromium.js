// SPDX-License-Identifier: Apache-2.0
// How the tests drive Chromium. firefox.js offers the same.
import {existsSync} from 'node:fs';
import {chromium} from 'playwright-core';

export const name = 'Chromium';

// The processor paints what is not WebGL without threads and shaders of its own.
const flags = ['--no-sandbox', '--disable-dev-shm-usage', '--use-gl=angle', '--use-angle=swiftshader',
               '--enable-unsafe-swiftshader', '--disable-gpu-watchdog', '--disable-gpu-rasterization'];
// Without the last two, canvases of WebGPU stay empty, and those of WebGL2 are lost.
const webgpuFlags = ['--enable-unsafe-webgpu', '--use-webgpu-adapter=swiftshader', '--enable-features=Vulkan',
                     '--use-vulkan=swiftshader'];

const gpuFlags = ['--no-sandbox', '--disable-dev-shm-usage', '--ignore-gpu-blocklist', '--use-gl=angle', '--use-angle=gl-egl',
                  '--enable-unsafe-webgpu'];

// The same engine without windows, whose pages take a third of the time of those of chromium, is what draws where it is installed.
const programs = ['/usr/bin/chromium-headless-shell', '/usr/bin/chromium'];

/** @param {{webgpu?: boolean, gpu?: boolean, webgl?: boolean}} [options] as launch() of browser.js takes them */
export const launch = ({webgpu = false, gpu = false, webgl = true} = {}) => chromium.launch({
  executablePath: process.env.L4D_CHROMIUM ?? programs.find(path => existsSync(path)),
  args: [...gpu ? gpuFlags : [...flags, ...webgpu ? webgpuFlags : []], ...webgl ? [] : ['--disable-3d-apis']]
});

/** Resolves once all that the page complained of until now has come: it has already. */
export const allSaid = async () => {};

/** Fingers on a page: as touch() of browser.js. @param {any} page */
export const touch = async page => {
  const session = await page.context().newCDPSession(page);
  const send = (/** @type {string} */ type) => (/** @type {number[][]} */ points = []) =>
    session.send('Input.dispatchTouchEvent', {type, touchPoints: points.map(([x, y], id) => ({id, x, y}))});
  return {start: send('touchStart'), move: send('touchMove'), end: () => send('touchEnd')()};
};

/** What is there behind a collection: as heap() of browser.js. @param {any} page */
export const heap = async page => {
  // gc() of a page keeps what its stack may point at; the debugger's collection does not.
  const session = page.heapSession ??= await page.context().newCDPSession(page);
  await session.send('Performance.enable');
  await session.send('HeapProfiler.collectGarbage');
  const {metrics} = await session.send('Performance.getMetrics');
  const value = (/** @type {string} */ name) => metrics.find((/** @type {any} */ metric) => metric.name === name).value;
  return {bytes: value('JSHeapUsedSize'), nodes: value('Nodes'), listeners: value('JSEventListeners')};
};
