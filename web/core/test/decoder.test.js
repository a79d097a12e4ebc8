// SPDX-License-Identifier: Apache-2.0
// l4d.wasm against the native tool: sizes, imports, the bits of all attributes, slices, errors.
import assert from 'node:assert/strict';
import {execFileSync} from 'node:child_process';
import {mkdtempSync, readFileSync, rmSync} from 'node:fs';
import {tmpdir} from 'node:os';
import {basename, join} from 'node:path';
import {test} from 'node:test';
import {gzipSync} from 'node:zlib';
import {details} from '../src/decoder.js';
import {frameOfTime} from '../src/timeline.js';
import {decoderAt, native, read, streamOf, streams, tool, wasm, wasmBytes} from './fixture.js';

const mostBytes = 150_000;

test('l4d.wasm is small and asks for nothing', () => {
  const size = gzipSync(wasmBytes, {level: 9}).length;
  console.log(`l4d.wasm: ${wasmBytes.length} bytes, ${size} with gzip -9`);
  assert.ok(size <= mostBytes, `${size} bytes, at most ${mostBytes}`);
  assert.deepEqual(WebAssembly.Module.imports(wasm).map(i => `${i.module}.${i.name}`).sort(), [
    'env.emscripten_notify_memory_growth', 'wasi_snapshot_preview1.fd_close', 'wasi_snapshot_preview1.proc_exit'
  ]);
});

/** The arrays of a file of safetensors. @param {string} name @returns {Record<string, Uint8Array>} */
const safetensors = name => {
  const bytes = readFileSync(name);
  const length = Number(bytes.readBigUInt64LE(0));
  const header = JSON.parse(bytes.subarray(8, 8 + length).toString());
  return Object.fromEntries(Object.entries(header).filter(([key]) => key !== '__metadata__')
    .map(([key, {data_offsets: [begin, end]}]) => [key, bytes.subarray(8 + length + begin, 8 + length + end)]));
};

/** What a row shows. @param {Float32Array} row @param {number} since the centre of its bucket, s @param {number} frame */
const opacityOf = (row, since, frame) => {
  if (row[15] < 0) return row[14] <= frame && frame < -row[15] ? row[3] : 0;
  const age = row[15] * (since - row[14]) ** 2;
  return age > 16 ? 0 : row[3] * Math.exp(-age / 2);
};

/** What `info` says of rendering and presentation, as the decoder has it. @param {any} told */
const statementsOf = ({rendering: {stated: _, min_alpha: minAlpha, max_alpha: maxAlpha, ...rest}, presentation}) => {
  const {playback, bounds, metres_per_unit: metres, camera} = presentation;
  return [{...rest, minAlpha, maxAlpha}, {
    playback: [null, 'once', 'loop', 'ping-pong'][playback] ?? null, metresPerUnit: metres || null, camera,
    bounds: bounds && {min: bounds[0], max: bounds[1]}
  }];
};

for (const name of streams) {
  for (const detail of /** @type {const} */ (['full', 'base'])) {
    test(`${basename(name)}: all attributes have the native bits, ${detail}`, async () => {
      const folder = mkdtempSync(join(tmpdir(), 'l4dweb-'));
      try {
        const raw = join(folder, 'raw.safetensors');
        execFileSync(tool, ['decode', name, '--format', 'raw', '-o', raw, '-q',
                            '--detail', detail === 'full' ? 'full' : 'base']);
        const wanted = safetensors(raw);
        const {decoder} = await decoderAt(read(name), 0, {whole: true}, {detail: details[detail]});
        decoder.select(0);
        const got = decoder.decode(1, 0, details[detail]);
        for (const [key, floats] of Object.entries(got)) {
          assert.ok(wanted[key], key);
          assert.ok(Buffer.from(floats.buffer).equals(wanted[key]), `${key} differs`);
        }
        assert.deepEqual(decoder.losses(), []);
      } finally {
        rmSync(folder, {recursive: true});
      }
    });
  }

  test(`${basename(name)}: info, rows and a slice`, async () => {
    const bytes = read(name);
    const {decoder, loads, time} = await decoderAt(bytes, 0.4);
    decoder.select(0);
    const info = decoder.info();
    const told = native('info', name);
    assert.equal(info.numGaussians, told.num_gaussians);
    assert.ok(Math.abs(info.duration - told.duration_s) < 1e-9);
    assert.deepEqual([info.rendering, info.presentation], statementsOf(told));
    assert.ok(loads.length > 0);
    const slice = (await decoderAt(bytes, 0.4, {slices: true})).decoder.slice(time, true);
    assert.equal(slice.count, native('slice', name, '--time', String(time), '--digest').frames[0].gaussians);
    assert.equal(slice.position.length, 3 * slice.count);
    // The rows show what the slice shows, in its order.
    let shown = 0;
    for (const {layer, bucket} of loads) {
      const rows = decoder.rows(layer, bucket, details.full);
      const sh = 3 * (info.shDegree + 1) ** 2;
      assert.equal(rows.shStride, Math.ceil(sh / 4) * 4);
      for (let k = 0; k < rows.count; ++k) {
        const row = rows.geometry.subarray(16 * k, 16 * k + 16);
        if (opacityOf(row, time - rows.center, frameOfTime(info, time)) >= 1 / 255) ++shown;
      }
    }
    const visible = slice.opacity.filter(o => o >= 1 / 255).length;
    assert.ok(Math.abs(shown - visible) <= Math.max(2, visible * 1e-4), `${shown} rows, ${visible} in the slice`);
  });
}

test('rows have SH of the degree that others have', async () => {
  const {decoder, loads: [{layer, bucket}]} = await decoderAt(read(streamOf('frames')), 0.5);
  decoder.select(0);
  const [own, wide] = [0, 3].map(degree => decoder.rows(layer, bucket, details.full, degree));
  assert.deepEqual([wide.shStride, wide.count], [48, own.count]);
  assert.ok(own.shStride < 48 && own.count > 0);
  const known = 3 * (decoder.info().shDegree + 1) ** 2;
  for (let k = 0; k < own.count; ++k) {
    const row = wide.sh.subarray(48 * k, 48 * (k + 1));
    assert.deepEqual(row.subarray(0, known), own.sh.subarray(own.shStride * k, own.shStride * k + known));
    assert.ok(row.subarray(known).every(value => value === 0));
  }
});

test('a damaged page is a loss, and what is left is shown', async () => {
  const bytes = read(streams[0]);
  bytes[bytes.length - 100] ^= 0x55;
  let losses = /** @type {any[]} */ ([]);
  for (let k = 0; k <= 10 && losses.length === 0; ++k) {
    const {decoder, loads, events} = await decoderAt(bytes, k / 10);
    decoder.select(0);
    for (const {layer, bucket} of loads) {
      const {count} = decoder.rows(layer, bucket, details.full);
      losses.push(...decoder.losses());
      assert.ok(count > 0 || losses.length > 0);
    }
    assert.ok(losses.length === 0 || events.some(e => e.event === 7));
  }
  assert.equal(losses.length, 1);
  assert.equal(losses[0].code, 'CHECKSUM');
  assert.match(losses[0].clause, /^[A-Z]+-\d+$/);
  assert.ok(losses[0].offset > 0);
});

test('flat windows: each frame shows its rows and no others, up to where it ends', async () => {
  const bytes = read(streamOf('frames'));
  const [early, late] = [-1e-9, 1e-9];
  const shares = [0, early, late].flatMap(off => [0, 1, 7, 14, 28, 29].map(frame => frame / 30 + off));
  for (const share of [...shares, 1, -1]) {
    const {decoder, loads, state: {time}} = await decoderAt(bytes, share);
    decoder.select(0);
    const info = decoder.info();
    const wanted = (await decoderAt(bytes, share, {slices: true})).decoder.slice(time, false);
    const frame = frameOfTime(info, time);
    /** @type {number[][]} */
    const got = [];
    for (const {layer, bucket} of loads.sort((a, b) => a.layer - b.layer || a.bucket - b.bucket)) {
      const rows = decoder.rows(layer, bucket, details.full);
      for (let k = 0; k < rows.count; ++k) {
        const row = rows.geometry.subarray(16 * k, 16 * k + 16);
        const since = time - rows.center;
        const opacity = opacityOf(row, since, frame);
        if (opacity >= 1 / 255) got.push([...[0, 1, 2].map(c => row[c] + row[4 + c] * (since - row[7])), opacity]);
      }
    }
    assert.ok(wanted.count > 0);
    assert.equal(got.length, wanted.count, `${time} s, frame ${frame}`);
    got.forEach(([x, y, z, opacity], k) => {
      assert.ok(Math.hypot(x - wanted.position[3 * k], y - wanted.position[3 * k + 1], z - wanted.position[3 * k + 2]) < 1e-4);
      assert.ok(Math.abs(opacity - wanted.opacity[k]) < 1e-6);
    });
  }
});

test('frames of times are those of the native tool', async () => {
  const info = {timeBegin: 12.5, numFrames: 300, rateNumerator: 30000, rateDenominator: 1001};
  const slack = 2 ** -11;
  for (const [frames, frame] of [[-3, 0], [0, 0], [1 - 2 * slack, 0], [1 - slack / 2, 1], [1.5, 1], [298.999, 298],
                                 [299, 299], [300, 299], [1e6, 299]]) {
    assert.equal(frameOfTime(info, 12.5 + frames * 1001 / 30000), frame, `${frames} frames`);
  }
  assert.equal(frameOfTime(info, NaN), 0);
  for (let frame = 0; frame < 300; ++frame) assert.equal(frameOfTime(info, 12.5 + frame * 1001 / 30000), frame);
});

test('tiers: each has the buckets of those below, more bytes, and its slices', async () => {
  const name = streamOf('tiers');
  const bytes = read(name);
  let before = new Set(), bytesBefore = 0;
  for (const maxTier of [0, 1, 2]) {
    const {decoder, loads, time, received} = await decoderAt(bytes, 0.4, {}, {maxTier});
    decoder.select(0);
    assert.equal(decoder.info().lastTier, 2);
    const buckets = new Set(loads.map(b => `${b.layer}/${b.bucket}`));
    assert.ok([...before].every(key => buckets.has(key)) && buckets.size > before.size, `tier ${maxTier}`);
    assert.ok(received > bytesBefore, `tier ${maxTier}: ${received} bytes`);
    [before, bytesBefore] = [buckets, received];
    assert.equal((await decoderAt(bytes, 0.4, {slices: true}, {maxTier})).decoder.slice(time, false).count,
                 native('slice', name, '--time', String(time), '--max-tier', String(maxTier), '--digest').frames[0].gaussians);
  }
});
