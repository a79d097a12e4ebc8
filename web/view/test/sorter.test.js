// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import {test} from 'node:test';
import {OrbitCamera} from '../src/camera.js';
import {Sorter} from '../src/sorter.js';
import {clockText, parseLink} from '../src/text.js';

/** Rows at random; lambda 0: always visible. @param {number} count @param {number} lambda */
const rowsOf = (count, lambda) => {
  const geometry = new Float32Array(16 * count);
  for (let k = 0; k < count; ++k) {
    const row = geometry.subarray(16 * k, 16 * k + 16);
    row.set([Math.random() - 0.5, Math.random() - 0.5, 1 + 9 * Math.random(), 0.1 + 0.9 * Math.random()]);
    row.set([0, 0, Math.random() - 0.5, 0], 4);
    row[14] = Math.random() * 4;
    row[15] = lambda;
  }
  return geometry;
};

test('the order is that of an exact sort, but for depths that 22 bits do not tell apart', () => {
  const sorter = new Sorter();
  const count = 30000;
  const geometry = rowsOf(count, 2);
  sorter.add('0/0', geometry, new Uint32Array(Math.ceil(count / 256)).map((_, k) => k), 10, 0);
  const order = sorter.sort({streams: [{stream: 0, time: 11.5, frame: 0}], depth: [0, 0, 1, 0], nearPlane: 0.01, minAlpha: 1 / 255});
  const at = k => geometry.subarray(16 * k, 16 * k + 16);
  const visible = k => {
    const age = at(k)[15] * (1.5 - at(k)[14]) ** 2;
    return age <= 16 && at(k)[3] * Math.exp(-0.5 * age) >= 1 / 255;
  };
  const depth = k => at(k)[2] + 1.5 * at(k)[6];
  const wanted = Array.from({length: count}, (_, k) => k).filter(k => visible(k) && depth(k) > 0.01);
  assert.equal(sorter.visible, wanted.length);
  assert.deepEqual(new Set(order.subarray(0, sorter.visible)), new Set(wanted));
  for (let k = 1; k < sorter.visible; ++k) assert.ok(depth(order[k]) <= depth(order[k - 1]) * (1 + 1e-5));
});

test('buckets come and go', () => {
  const sorter = new Sorter();
  const sight = {streams: [{stream: 0, time: 0, frame: 0}], depth: /** @type {any} */ ([0, 0, 1, 0]), nearPlane: 0.01, minAlpha: 1 / 255};
  sorter.add('a', rowsOf(300, 0), Uint32Array.of(4, 9), 0, 0);
  sorter.add('b', rowsOf(10, 0), Uint32Array.of(2), 0, 0);
  const order = sorter.sort(sight);
  assert.equal(sorter.visible, 310);
  assert.deepEqual([...new Set([...order.subarray(0, 310)].map(id => id >> 8))].sort(), [2, 4, 9]);
  sorter.add('a', rowsOf(5, 0), Uint32Array.of(4), 0, 0);
  sorter.remove('b');
  assert.equal(sorter.sort(sight, order), order);
  assert.equal(sorter.visible, 5);
  sorter.clear();
  sorter.sort(sight);
  assert.equal(sorter.visible, 0);
  assert.equal(sorter.bounds(sight.streams), null);
});

test('rows of a stream are seen while it is shown, each stream at its own time', () => {
  const sorter = new Sorter();
  sorter.add('a', rowsOf(3, 0), Uint32Array.of(0), 0, 0);
  const moving = rowsOf(5, 0);
  for (let k = 0; k < 5; ++k) moving[16 * k + 6] = 0.5;
  sorter.add('b', moving, Uint32Array.of(1), 0, 7);
  const count = (/** @type {any[]} */ streams) => {
    sorter.sort({streams, depth: [0, 0, 1, 0], nearPlane: 0.01, minAlpha: 1 / 255});
    return sorter.visible;
  };
  assert.equal(count([{stream: 0, time: 0, frame: 0}, {stream: 7, time: 0, frame: 0}]), 8);
  assert.equal(count([{stream: 7, time: 0, frame: 0}]), 5);
  assert.equal(count([{stream: 8, time: 0, frame: 0}]), 0);
  assert.equal(sorter.bounds([{stream: 8, time: 0, frame: 0}]), null);
  // They move away by half a unit a second: a minute before, they were behind the camera.
  assert.equal(count([{stream: 0, time: 0, frame: 0}, {stream: 7, time: -60, frame: 0}]), 3);
});

test('flat windows are seen in their frames', () => {
  const sorter = new Sorter();
  const geometry = rowsOf(6, 0);
  for (let k = 0; k < 6; ++k) geometry.set([2 * k, -(2 * k + 3)], 16 * k + 14);  // frames 2k to 2k + 2
  sorter.add('a', geometry, Uint32Array.of(0), 3, 0);
  for (let frame = 0; frame < 15; ++frame) {
    const streams = [{stream: 0, time: 3, frame}];
    const order = sorter.sort({streams, depth: [0, 0, 1, 0], nearPlane: 0.01, minAlpha: 1 / 255});
    const seen = [...order.subarray(0, sorter.visible)].sort();
    assert.deepEqual(seen, [0, 1, 2, 3, 4, 5].filter(k => 2 * k <= frame && frame < 2 * k + 3), `frame ${frame}`);
    assert.equal(sorter.bounds(streams) === null, seen.length === 0);
  }
});

test('cameras look at their target, and links keep them', () => {
  const camera = new OrbitCamera();
  camera.frame({middle: [1, 2, 3], radius: 2}, 0);
  camera.orbit(0.7, 0.3);
  const {worldToCamera: m, cx, cy} = camera.camera(640, 360);
  const [x, y, z] = [0, 4, 8].map(r => m[r] * 1 + m[r + 1] * 2 + m[r + 2] * 3 + m[r + 3]);
  assert.ok(Math.abs(x) < 1e-9 && Math.abs(y) < 1e-9 && Math.abs(z - camera.distance) < 1e-9);
  assert.deepEqual([cx, cy], [320, 180]);
  assert.ok(m[5] > 0.5, 'y is down');
  camera.frame({middle: [0, 0, 0], radius: 2}, 1);
  assert.deepEqual(camera.up, [0, 1, 0]);
  camera.frame({middle: [1, 2, 3], radius: 2}, 0);
  camera.orbit(0.7, 0.3);
  const other = new OrbitCamera();
  assert.ok(other.parse(String(camera)));
  assert.ok(Math.abs(other.yaw - camera.yaw) < 1e-3);
  for (const bad of ['', '1,2', '1,2,3,x,5,6,7,8,9', '0,0,0,-1,0,0,0,1,0']) assert.ok(!other.parse(bad), bad);
  const same = new OrbitCamera();
  same.lookAt(camera.eye(), camera.target);
  camera.axes().forEach((axis, i) => axis.forEach((v, k) => assert.ok(Math.abs(v - same.axes()[i][k]) < 1e-9)));
  const eye = camera.eye();
  camera.look(0.2, 0.1);
  assert.ok(Math.hypot(...eye.map((v, k) => v - camera.eye()[k])) < 1e-9);
});

test('words', () => {
  assert.equal(clockText(62.54), '1:02.5');
  assert.equal(clockText(3600), '1:00:00.0');
  assert.equal(clockText(59.99), '1:00.0');
  assert.deepEqual(parseLink('#t=1.5&cam=1,2'), {time: 1.5, camera: '1,2', player: undefined});
  assert.deepEqual(parseLink('#t=1&player=a%20b'), {time: 1, camera: undefined, player: 'a b'});
  assert.deepEqual(parseLink(''), {time: undefined, camera: undefined, player: undefined});
});

test('a ray ends where half of its light is gone, or most of what goes', () => {
  const sorter = new Sorter();
  const sight = {streams: [{stream: 0, time: 1, frame: 0}], depth: /** @type {any} */ ([0, 0, 1, 0]), nearPlane: 0.5, minAlpha: 1 / 255};
  /** @type {any} */
  const ray = {origin: [0, 0, 0], direction: [0.1, 0, 1], blur: 1e-3};
  // x, z, opacity, speed along x: a haze, a wall behind it, one behind that, one aside, one behind the camera, one that moves there.
  const splats = [[0.2, 2, 0.3, 0], [0.4, 4, 0.9, 0], [0.6, 6, 1, 0], [2, 3, 1, 0], [-1, 0.1, 1, 0], [-0.9, 1, 1, 1]];
  const rowsOfThese = (/** @type {number[][]} */ these) => {
    const geometry = new Float32Array(16 * these.length);
    these.forEach(([x, z, opacity, speed], k) => {
      geometry.set([x, 0, z, opacity, speed], 16 * k);
      geometry.set([0.01, 0, 0, 0.01, 0, 0.0001], 16 * k + 8);
    });
    return geometry;
  };
  const pick = (/** @type {number[][]} */ these) => {
    sorter.add('a', rowsOfThese(these), Uint32Array.of(0), 0, 0);
    return sorter.pick(sight, ray);
  };
  assert.deepEqual(pick(splats)?.map(v => Math.round(1e6 * v) / 1e6), [0.1, 0, 1]);
  assert.deepEqual(pick(splats.slice(0, 5))?.map(v => Math.round(1e6 * v) / 1e6), [0.4, 0, 4]);
  assert.deepEqual(pick(splats.slice(0, 1))?.map(v => Math.round(1e6 * v) / 1e6), [0.2, 0, 2]);
  assert.equal(pick([[0.2, 2, 0.05, 0]]), null);
  assert.equal(pick(splats.slice(3, 5)), null);
});
