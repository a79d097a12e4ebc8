// SPDX-License-Identifier: Apache-2.0
// l4d.wasm against the native tool: sizes, imports, the bits of all attributes, slices, errors.
import assert from 'node:assert/strict';
import {execFileSync} from 'node:child_process';
import {mkdtempSync, readFileSync, rmSync} from 'node:fs';
import {tmpdir} from 'node:os';
import {basename, join} from 'node:path';
import {test} from 'node:test';
import {gzipSync} from 'node:zlib';
import {details, steps} from '../src/decoder.js';
import {frameOfTime} from '../src/timeline.js';
import {decoderOf, native, read, streamOf, streams, tool, wasm, wasmBytes} from './fixture.js';

const mostBytes = 150_000;

test('l4d.wasm is small and asks for nothing but bytes', () => {
  const size = gzipSync(wasmBytes, {level: 9}).length;
  console.log(`l4d.wasm: ${wasmBytes.length} bytes, ${size} with gzip -9`);
  assert.ok(size <= mostBytes, `${size} bytes, at most ${mostBytes}`);
  assert.deepEqual(WebAssembly.Module.imports(wasm).map(i => `${i.module}.${i.name}`).sort(), [
    'env.emscripten_notify_memory_growth', 'l4d.read_at', 'wasi_snapshot_preview1.fd_close',
    'wasi_snapshot_preview1.proc_exit'
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
        const decoder = await decoderOf(read(name));
        decoder.open();
        const got = decoder.decode(1, 0, details[detail]);
        for (const [key, floats] of Object.entries(got ?? {})) {
          assert.ok(wanted[key], key);
          assert.ok(Buffer.from(floats.buffer).equals(wanted[key]), `${key} differs`);
        }
        assert.deepEqual(decoder.losses(), []);
      } finally {
        rmSync(folder, {recursive: true});
      }
    });
  }

  test(`${basename(name)}: info, buckets, rows and a slice`, async () => {
    const decoder = await decoderOf(read(name));
    decoder.open();
    const info = decoder.info();
    const told = native('info', name);
    assert.equal(info.numGaussians, told.num_gaussians);
    assert.ok(Math.abs(info.duration - told.duration_s) < 1e-9);
    assert.deepEqual([info.rendering, info.presentation], statementsOf(told));
    const time = info.timeBegin + 0.4 * info.duration;
    const buckets = decoder.buckets(time, time) ?? [];
    assert.ok(buckets.length > 0);
    const slice = decoder.slice(time);
    assert.equal(slice?.count, native('slice', name, '--time', String(time), '--digest').frames[0].gaussians);
    assert.equal(slice?.position.length, 3 * (slice?.count ?? 0));
    // The rows show what the slice shows, in its order.
    let shown = 0;
    for (const {layer, bucket} of buckets) {
      const rows = decoder.rows(layer, bucket, details.full);
      assert.ok(rows);
      const sh = 3 * (info.shDegree + 1) ** 2;
      assert.equal(rows.shStride, Math.ceil(sh / 4) * 4);
      for (let k = 0; k < rows.count; ++k) {
        const row = rows.geometry.subarray(16 * k, 16 * k + 16);
        if (opacityOf(row, time - rows.center, frameOfTime(info, time)) >= 1 / 255) ++shown;
      }
    }
    const visible = slice?.opacity.filter(o => o >= 1 / 255).length ?? 0;
    assert.ok(Math.abs(shown - visible) <= Math.max(2, visible * 1e-4), `${shown} rows, ${visible} in the slice`);
  });
}

test('errors have code, clause and offset', async () => {
  const bytes = read(streams[0]);
  const none = await decoderOf(new Uint8Array(64));
  assert.throws(() => none.open(), {name: 'L4DError', code: 'NOT_L4D'});
  const damaged = bytes.slice();
  damaged[60] ^= 0x55;
  const broken = await decoderOf(damaged);
  assert.throws(() => broken.open(), error => {
    assert.match(/** @type {any} */ (error).code, /CORRUPT|CHECKSUM/);
    assert.match(/** @type {any} */ (error).clause, /^[A-Z]+-\d+$/);
    assert.ok(/** @type {any} */ (error).offset >= 0);
    return true;
  });
  const strict = await decoderOf(bytes, {tolerant: false});
  strict.open();
  assert.equal(strict.slice(0)?.shDegree, strict.info().shDegree);
});

test('a damaged page is a loss, and what is left is shown', async () => {
  const bytes = read(streams[0]);
  bytes[bytes.length - 100] ^= 0x55;
  const decoder = await decoderOf(bytes);
  decoder.open();
  const {timeBegin, duration} = decoder.info();
  let losses = [];
  for (let k = 0; k <= 10 && losses.length === 0; ++k) {
    assert.ok((decoder.slice(timeBegin + duration * k / 10)?.count ?? 0) > 0);
    losses = decoder.losses();
  }
  assert.equal(losses.length, 1);
  assert.equal(losses[0].code, 'CHECKSUM');
  assert.ok(losses[0].offset > 0);
});

test('a limit on memory is a status', async () => {
  const decoder = await decoderOf(read(streams[0]), {maxMemoryBytes: 200_000});
  assert.throws(() => {
    decoder.open();
    decoder.slice(0);
  }, {name: 'L4DError', code: 'LIMIT_EXCEEDED'});
});

test('flat windows: each frame shows its rows and no others, up to where it ends', async () => {
  const decoder = await decoderOf(read(streamOf('frames')));
  decoder.open();
  const info = decoder.info();
  const [early, late] = [-1e-9, 1e-9];
  const times = [0, early, late].flatMap(off => [0, 1, 7, 14, 28, 29].map(frame => info.timeBegin + frame / info.frameRate + off));
  for (const time of [...times, info.timeBegin + info.duration, info.timeBegin - 1]) {
    const wanted = decoder.slice(time);
    const frame = frameOfTime(info, time);
    /** @type {number[][]} */
    const got = [];
    for (const {layer, bucket} of decoder.buckets(time, time) ?? []) {
      const rows = decoder.rows(layer, bucket, details.full);
      assert.ok(rows);
      for (let k = 0; k < rows.count; ++k) {
        const row = rows.geometry.subarray(16 * k, 16 * k + 16);
        const since = Math.min(Math.max(time, info.timeBegin), info.timeBegin + info.duration) - rows.center;
        const opacity = opacityOf(row, since, frame);
        if (opacity >= 1 / 255) got.push([...[0, 1, 2].map(c => row[c] + row[4 + c] * (since - row[7])), opacity]);
      }
    }
    assert.ok(wanted && wanted.count > 0);
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

test('tiers: each has the buckets of those below, and their slices', async () => {
  const name = streamOf('tiers');
  const decoder = await decoderOf(read(name));
  decoder.open();
  const info = decoder.info();
  assert.equal(info.lastTier, 2);
  const time = info.timeBegin + 0.4 * info.duration;
  let before = new Set(), bytesBefore = 0;
  for (const maxTier of [0, 1, 2]) {
    const buckets = new Set(decoder.buckets(time, time, {maxTier})?.map(b => `${b.layer}/${b.bucket}`));
    assert.ok([...before].every(key => buckets.has(key)) && buckets.size > before.size, `tier ${maxTier}`);
    const bytes = decoder.windowReads(time, time, {maxTier}, steps.all)?.reduce((sum, [, size]) => sum + size, 0) ?? 0;
    assert.ok(bytes > bytesBefore, `tier ${maxTier}: ${bytes} bytes`);
    [before, bytesBefore] = [buckets, bytes];
    assert.equal(decoder.slice(time, {maxTier})?.count,
                 native('slice', name, '--time', String(time), '--max-tier', String(maxTier), '--digest').frames[0].gaussians);
  }
  assert.equal(decoder.slice(time)?.count, decoder.slice(time, {maxTier: 2})?.count);
});
