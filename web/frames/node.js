// SPDX-License-Identifier: Apache-2.0
// usage: node web/frames/node.js FOLDER_OF_PACKAGE_webgpu [SCENE.l4d TIME CAMERAS.json ID PICTURE.rgb]...
// The back end of WebGPU without a browser, on a GPU that Vulkan finds: what a frame of made Gaussians costs there, and
// pictures of scenes against those of `l4dcodec render` (640x360, three bytes a pixel). FOLDER: where
// `npm install webgpu` has put Dawn's bindings.
import {createRequire} from 'node:module';
import {readFileSync} from 'node:fs';
import {compile} from '../core/src/decoder.js';
import {frameOfTime} from '../core/src/timeline.js';
import {decoderAt} from '../test/at-hand.js';
import {OrbitCamera} from '../view/src/camera.js';
import {GpuPainter} from '../view/src/webgpu/painter.js';
import {bufferUsage, mapRead, textureUsage} from '../view/src/webgpu/usage.js';
import {bucketRows, degree, makeRows, median, streams} from './rows.js';

const [folder, ...words] = process.argv.slice(2);
const {create} = await import(createRequire(import.meta.url).resolve(folder));
const gpu = create([]);
const adapter = await gpu.requestAdapter({powerPreference: 'high-performance'});
if (!adapter) throw new Error('no adapter');
const {maxStorageBufferBindingSize, maxBufferSize} = adapter.limits;
const device = await adapter.requestDevice({
  requiredFeatures: ['timestamp-query'], requiredLimits: {maxStorageBufferBindingSize, maxBufferSize}
});
device.onuncapturederror = ({error}) => { throw new Error(error.message); };
console.log(`${adapter.info.vendor} ${adapter.info.architecture}: ${adapter.info.description || adapter.info.device}`);

/** A painter onto a texture. */
const painterOf = (width, height, maxRows, shDegree) => {
  const texture = device.createTexture({size: [width, height], format: 'rgba8unorm', usage: textureUsage.renderAttachment});
  return new GpuPainter(device, /** @type {any} */ ({getCurrentTexture: () => texture}), 'rgba8unorm',
                        {maxRows, shDegree, target: '16f'});
};

/** Least ms of a pass of the GPU in some frames: of what comes before drawing, and of drawing. */
const passTimes = async (painter, draw) => {
  const queries = device.createQuerySet({type: 'timestamp', count: 4});
  const resolved = device.createBuffer({size: 256, usage: 0x200 | bufferUsage.copySrc});
  const read = device.createBuffer({size: 32, usage: bufferUsage.mapRead | bufferUsage.copyDst});
  painter.timing = pass => ({querySet: queries, beginningOfPassWriteIndex: pass === 'order' ? 0 : 2,
                             endOfPassWriteIndex: pass === 'order' ? 1 : 3});
  const orders = [], draws = [];
  for (let k = 0; k < 9; ++k) {
    draw();
    const encoder = device.createCommandEncoder();
    encoder.resolveQuerySet(queries, 0, 4, resolved, 0);
    encoder.copyBufferToBuffer(resolved, 0, read, 0, 32);
    device.queue.submit([encoder.finish()]);
    await read.mapAsync(mapRead);
    const [a, b, c, d] = new BigUint64Array(read.getMappedRange().slice(0));
    read.unmap();
    orders.push(Number(b - a) / 1e6);
    draws.push(Number(d - c) / 1e6);
  }
  painter.timing = null;
  return [median(orders), median(draws)];
};

const measure = async (count, width, height, frames) => {
  const painter = painterOf(width, height, count + bucketRows, degree);
  for (const rows of makeRows(count)) painter.store.add(/** @type {any} */ (rows));
  const orbit = new OrbitCamera();
  orbit.distance = 2.6;
  const cpu = [];
  const draw = () => {
    orbit.orbit(0.01, 0);
    const began = performance.now();
    painter.draw(orbit.camera(width, height), streams, width, height, [0, 0, 0]);
    cpu.push(performance.now() - began);
  };
  draw();
  await painter.finished();
  const began = performance.now();
  for (let k = 0; k < frames; ++k) draw();
  await painter.finished();
  const frame = (performance.now() - began) / frames;
  const [order, drawing] = await passTimes(painter, draw);
  await new Promise(resolve => setTimeout(resolve, 50));
  console.log(`| ${width}x${height} | ${painter.count.toLocaleString('en')} | ${median(cpu).toFixed(2)} | ${order.toFixed(2)} | ` +
              `${drawing.toFixed(2)} | ${frame.toFixed(2)} |`);
  painter.dispose();
};

/** A picture against that of the tool. */
const compare = async (file, at, cameras, id, wanted) => {
  const wasm = await compile(readFileSync(new URL('../../build/wasm/bin/l4d.wasm', import.meta.url)));
  const {decoder, loads} = await decoderAt(wasm, readFileSync(file), 0, {at});
  decoder.select(0);
  const info = decoder.info();
  const painter = painterOf(640, 360, 2 ** 20, info.shDegree);
  for (const b of loads) {
    painter.store.add(/** @type {any} */ ({...decoder.rows(b.layer, b.bucket, 0), stream: 0, key: `${b.layer}/${b.bucket}`}));
  }
  const {K, w2c} = JSON.parse(readFileSync(cameras).toString()).cameras.find(c => c.id === id);
  painter.draw({worldToCamera: w2c.flat(), fx: K[0][0], fy: K[1][1], cx: K[0][2], cy: K[1][2], nearPlane: 0.02},
               [{stream: 0, time: at, frame: frameOfTime(info, at)}], 640, 360, [0, 0, 0]);
  const got = await painter.pixels();
  const picture = readFileSync(wanted);
  let sum = 0;
  for (let k = 0; k < picture.length; ++k) sum += (got[4 * Math.floor(k / 3) + k % 3] - picture[k]) ** 2;
  console.log(`${file} at ${at} s, camera ${id}: ${(10 * Math.log10(255 * 255 * picture.length / Math.max(sum, 1e-9))).toFixed(2)} dB`);
  painter.dispose();
};

for (let k = 0; k < words.length; k += 5) {
  await compare(words[k], Number(words[k + 1]), words[k + 2], Number(words[k + 3]), words[k + 4]);
}
console.log('| picture | seen | page, ms | GPU: slice and sort, ms | GPU: draw, ms | from frame to frame, ms |\n|---|---|---|---|---|---|');
const small = Boolean(process.env.L4D_SMALL);
for (const [width, height] of small ? [[320, 180]] : [[1920, 1080], [640, 360]]) {
  for (const count of small ? [20000] : [150_000, 500_000, 1_000_000]) await measure(count, width, height, small ? 3 : 60);
}
process.exit(0);
