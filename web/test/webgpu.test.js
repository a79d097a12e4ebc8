// SPDX-License-Identifier: Apache-2.0
// The back end of WebGPU in Chromium: its sort, lost devices, and pages that have no WebGPU. images.test.js compares
// its pictures.
import assert from 'node:assert/strict';
import {join} from 'node:path';
import {after, before, test} from 'node:test';
import {blankPage, complaints, hasWebGpu, launch, newPage, opened, serve, work} from './browser.js';

// The processor takes long for it.
const all = process.env.L4D_WEB_VIEWS === 'all';
const leftOut = all ? undefined : 'L4D_WEB_VIEWS=all (./dev web, ./dev nightly)';
if (leftOut) console.log(`SKIPPED: WebGPU: a million keys, and a process of the GPU that dies while WebGPU draws: ${leftOut}`);
// Of numbers of keys, powers of two: of votes of a word, of keys of a round and of a tile, and of several tiles.
const powers = all ? Array.from({length: 13}, (_, k) => k + 2) : [2, 5, 8, 11, 14];

let browser, server, has;
before(async () => {
  browser = await launch({webgpu: true});
  server = await serve({'scene.l4d': join(work, 'short.l4d')}, {}, 'build/web');
  const page = await blankPage(browser, server.url);
  has = await hasWebGpu(page);
  await page.close();
});
after(async () => {
  await browser?.close();
  server?.close();
});

/** A test that needs WebGPU. @param {string} name @param {(t: any) => Promise<void>} fn @param {string} [skip] why it is left out */
const gpuTest = (name, fn, skip) => test(name, {skip}, t => has ? fn(t) : t.skip('no WebGPU'));

/** In the page: a device, and a function that sorts keys; values are the places of the keys before. */
const prepareSort = async () => {
  const {RadixSort} = await import('/l4dcodec-player/src/webgpu/sort.js');
  const {bufferUsage: usage, mapRead} = await import('/l4dcodec-player/src/webgpu/usage.js');
  const device = await (await navigator.gpu.requestAdapter()).requestDevice();
  const errors = [];
  device.onuncapturederror = ({error}) => errors.push(error.message);
  const sort = new RadixSort(device);
  const total = device.createBuffer({size: 16, usage: usage.storage | usage.copyDst});
  Object.assign(globalThis, {sortErrors: errors, sortOnGpu: async (/** @type {Uint32Array} */ keys) => {
    const room = Math.max(keys.length, 1);
    if (room > sort.capacity) sort.reserve(room, total);
    device.queue.writeBuffer(total, 0, Uint32Array.of(4, keys.length, 0, 0));
    device.queue.writeBuffer(sort.keys, 0, keys);
    device.queue.writeBuffer(sort.values, 0, Uint32Array.from(keys, (_, k) => k));
    const read = device.createBuffer({size: 8 * room, usage: usage.mapRead | usage.copyDst});
    const encoder = device.createCommandEncoder();
    const pass = encoder.beginComputePass();
    sort.encode(pass);
    pass.end();
    encoder.copyBufferToBuffer(sort.keys, 0, read, 0, 4 * room);
    encoder.copyBufferToBuffer(sort.values, 0, read, 4 * room, 4 * room);
    device.queue.submit([encoder.finish()]);
    await read.mapAsync(mapRead);
    const both = new Uint32Array(read.getMappedRange().slice(0));
    read.destroy();
    return [both.subarray(0, keys.length), both.subarray(room, room + keys.length)];
  }});
};

/** In the page: sorts keys of a kind, and compares with a sort of keys and places as one number. */
const checkSort = async ([kind, count]) => {
  const {sortOnGpu, sortErrors} = /** @type {any} */ (globalThis);
  let state = 1 + count;
  const random = () => {
    state = Math.imul(state ^ state >>> 15, 0x2c1b3c6d) + 0x9e3779b9 >>> 0;
    return (state ^ state >>> 13) >>> 0;
  };
  const make = {
    random, few: () => random() % 5 * 0x10203, equal: () => 0xffffffff, rising: k => k * 3, falling: k => 0xffffffff - k,
    depths: () => ~new Uint32Array(Float32Array.of(0.5 + random() / 2 ** 30).buffer)[0] >>> 0
  }[kind];
  const keys = Uint32Array.from({length: count}, (_, k) => make(k));
  const places = 2 ** 21;
  const wanted = Float64Array.from(keys, (key, k) => key * places + k).sort();
  const [sorted, values] = await sortOnGpu(keys);
  const wrong = wanted.findIndex((both, k) => sorted[k] !== Math.floor(both / places) || values[k] !== both % places);
  return {wrong, errors: sortErrors, distinct: new Set(keys).size};
};

gpuTest('the sort is right and stable: no key, one, and around powers of two', async () => {
  const page = await blankPage(browser, server.url);
  await page.evaluate(prepareSort);
  const counts = [0, 1, 2];
  for (const k of powers) counts.push(2 ** k - 1, 2 ** k, 2 ** k + 1);
  for (const count of counts) {
    for (const kind of ['random', 'few']) {
      const {wrong, errors} = await page.evaluate(checkSort, [kind, count]);
      assert.deepEqual(errors, []);
      assert.equal(wrong, -1, `${count} keys, ${kind}`);
    }
  }
  for (const kind of ['equal', 'rising', 'falling', 'depths']) {
    assert.equal((await page.evaluate(checkSort, [kind, 10000])).wrong, -1, kind);
  }
  await page.close();
});

gpuTest('the sort is right and stable: a million and more keys', async () => {
  const page = await blankPage(browser, server.url);
  await page.evaluate(prepareSort);
  for (const [kind, count] of [['depths', 1_000_000], ['few', 2 ** 20 + 1]]) {
    const {wrong, errors, distinct} = await page.evaluate(checkSort, [kind, count]);
    assert.deepEqual(errors, []);
    assert.equal(wrong, -1, `${count} keys, ${kind}, ${distinct} of them distinct`);
  }
  await page.close();
}, leftOut);

/** A page with a player; the element gets these attributes. */
const withPlayer = async (attributes, fn, init, from = browser) => {
  const files = await serve({'scene.l4d': join(work, 'short.l4d')});
  const page = await newPage(from, {viewport: {width: 320, height: 180}});
  try {
    if (init) await page.addInitScript(init);
    await page.route('**/blank.html', route => route.fulfill({contentType: 'text/html', body:
      `<!doctype html><style>body { margin: 0 } l4d-player { width: 320px; height: 180px; --l4d-radius: 0 }</style>
       <l4d-player src="scene.l4d" ${attributes}></l4d-player><script>
         document.querySelector('l4d-player').addEventListener('backend', e => { globalThis.backendSeen = e.detail; });
       </script><script type="module" src="player.js"></script>`}));
    await page.goto(`${files.url}blank.html`);
    await opened(page);
    await fn(page);
  } finally {
    await page.close();
    files.close();
  }
};
const inPlayer = (page, fn) => page.evaluate(`(${fn})(document.querySelector('l4d-player'))`);
const backendOf = page => inPlayer(page, player => [player.view.backend, player.view.fallback, globalThis.backendSeen]);
const light = page => inPlayer(page, async player => {
  const pixels = await player.view.pixels();
  return pixels.reduce((a, b, k) => a + (k % 4 === 3 ? 0 : b), 0) / pixels.length;
});

// In one page, since the processor takes long to compile the shaders of each.
gpuTest('a player that draws with WebGPU', t => withPlayer('backend="webgpu"', async page => {
  await t.test('the player draws with WebGPU, onto its canvas', async () => {
    assert.deepEqual(await backendOf(page), ['webgpu', null, 'webgpu']);
    const [, mean] = await inPlayer(page, async player => {
      const {view} = player;
      const {width, height} = view.canvas;
      view.change();
      await view.settled();
      const context = new OffscreenCanvas(width, height).getContext('2d');
      context.drawImage(view.canvas, 0, 0);
      const shown = context.getImageData(0, 0, width, height).data;
      const pixels = await view.pixels();
      const difference = pixels.reduce((most, v, k) => Math.max(most, Math.abs(v - shown[k])), 0);
      return [difference, difference === 0 ? pixels.reduce((a, b, k) => a + (k % 4 === 3 ? 0 : b), 0) / pixels.length : 0];
    });
    assert.ok(mean > 5, `${mean}`);
    const frames = await inPlayer(page, async player => {
      const before = player.view.stats.frames;
      player.movie.play();
      await until(() => player.view.stats.frames >= before + 3, '3 pictures');
      player.movie.pause();
      await player.view.settled();
      await player.view.painter.finished();
      return [player.view.stats.frames - before, player.view.painter.count, player.movie.statistics.rows];
    });
    assert.ok(frames[0] >= 3 && frames[1] > 100 && frames[1] <= frames[2], `${frames}`);
    assert.deepEqual(await complaints(page), []);
  });
  await t.test('the number of splats is that of the last picture, also of a single one', async () => {
    const counts = await inPlayer(page, async ({movie, view}) => {
      movie.pause();
      await movie.seek(1);
      await until(() => movie.ready.detail === 'full', 'all of the instant');
      const counted = async () => {
        await view.settled();
        const {frames} = view.stats;
        await view.painter.finished();
        await until(() => !view.painter.reading, 'the number of splats to be read');
        return frames === view.stats.frames ? view.stats.visible : 'another picture was drawn';
      };
      const first = await counted();
      // Two pictures at once: the number is that of the second one.
      view.orbit.zoom(0.5);
      view.change();
      await view.settled();
      view.orbit.lookAt([0, 0, -100], [0, 0, -200]);
      view.change();
      const away = await counted();
      await view.home();
      return [first, away, await counted()];
    });
    assert.ok(counts[0] > 100 && counts[2] === counts[0], `${counts}`);
    assert.equal(counts[1], 0);
  });
  await t.test('a lost device is replaced by another one, with the picture', async () => {
    const before = await light(page);
    const replaced = await inPlayer(page, async player => {
      const {surface} = player.view;
      const {device} = surface;
      const ready = new Promise(resolve => player.movie.on('ready', v => v.detail === 'full' && resolve()));
      device.destroy();
      await device.lost;
      await ready;
      return surface.device !== device && !surface.isLost;
    });
    assert.equal(replaced, true);
    assert.ok(Math.abs(await light(page) - before) < 0.5);
    assert.deepEqual(await complaints(page), []);
  });
}));

for (const backend of ['webgpu', 'webgl2']) {
  gpuTest(`the picture comes back after the process of the GPU died: ${backend}`, async () => {
    // What it leaves of WebGPU is nothing for other tests.
    const own = await launch({webgpu: true});
    try {
      await withPlayer(`backend="${backend}"`, async page => {
        const before = await light(page);
        await inPlayer(page, ({view, movie}) => {
          const restored = view.surface.onrestored;
          view.surface.onrestored = () => {
            restored();
            movie.on('ready', ready => { globalThis.restored = ready.detail === 'full'; });
          };
        });
        await (await own.newBrowserCDPSession()).send('Browser.crashGpuProcess');
        await page.waitForFunction(() => globalThis.restored);
        assert.ok(Math.abs(await light(page) - before) < 0.5);
      }, undefined, own);
    } finally {
      await own.close();
    }
  }, backend === 'webgpu' ? leftOut : undefined);  // a lost device, above, comes back the same way
}

test('without WebGPU, WebGL2 draws and the view says why', () => withPlayer('backend="webgpu"', async page => {
  const [backend, fallback, seen] = await backendOf(page);
  assert.deepEqual([backend, seen], ['webgl2', 'webgl2']);
  assert.match(fallback, /no WebGPU/);
  assert.ok(await light(page) > 5);
  assert.deepEqual(await complaints(page), []);
}, () => { delete Object.getPrototypeOf(navigator).gpu; }));

test('so it does without an adapter', () => withPlayer('backend="webgpu"', async page => {
  const [backend, fallback] = await backendOf(page);
  assert.equal(backend, 'webgl2');
  assert.match(fallback, /no adapter/);
  assert.ok(await light(page) > 5);
}, () => {
  Object.defineProperty(navigator, 'gpu', {configurable: true, value: {requestAdapter: () => Promise.resolve(null)}});
}));

gpuTest('a player takes no WebGPU on the processor unless it is told to', () => withPlayer('', async page => {
  const [backend, fallback] = await backendOf(page);
  assert.equal(backend, 'webgl2');
  assert.match(fallback, /on the processor/);
}));

gpuTest('but that of a graphics card', () => withPlayer('', async page => {
  assert.deepEqual(await backendOf(page), ['webgpu', null, 'webgpu']);
  assert.ok(await light(page) > 5);
}, () => {
  Object.defineProperty(GPUAdapter.prototype, 'info', {get: () => ({isFallbackAdapter: false})});
}));

gpuTest('rows grow, come and go', async () => {
  const page = await blankPage(browser, server.url);
  const result = await page.evaluate(async () => {
    const {RowBuffers} = await import('/l4dcodec-player/src/webgpu/rows.js');
    const {bufferUsage: usage, mapRead} = await import('/l4dcodec-player/src/webgpu/usage.js');
    const device = await (await navigator.gpu.requestAdapter()).requestDevice();
    const errors = [];
    device.onuncapturederror = ({error}) => errors.push(error.message);
    const store = new RowBuffers(device, 100 * 256, 3);
    const rowsOf = (key, count, value) => ({
      key, count, stream: 3, center: 2, shStride: 12, geometry: new Float32Array(16 * count).fill(value),
      sh: new Uint16Array(12 * count).fill(value)
    });
    const fits = [['a', 700, 1], ['b', 256, 2], ['c', 257, 3], ['d', 90 * 256, 4]]
      .map(([key, count, value]) => store.add(rowsOf(key, count, value)) !== null);
    const held = store.held;
    store.remove('b');
    const tooMany = store.add(rowsOf('e', 6 * 256, 5));
    const other = store.add(rowsOf('f', 5 * 256, 6));
    const {data, count} = store.shown([{stream: 3, time: 3.5, frame: 7}, {stream: 4, time: 0, frame: 0}]);
    const ofOthers = store.shown([{stream: 4, time: 0, frame: 0}]).count;
    const read = async (buffer, size) => {
      const to = device.createBuffer({size, usage: usage.mapRead | usage.copyDst});
      const encoder = device.createCommandEncoder();
      encoder.copyBufferToBuffer(buffer, 0, to, 0, size);
      device.queue.submit([encoder.finish()]);
      await to.mapAsync(mapRead);
      return to.getMappedRange().slice(0);
    };
    const geometry = new Float32Array(await read(store.rows, 64 * 256 * store.held));
    const sh = new Uint16Array(await read(store.harmonics, 24 * 256 * store.held));
    const wrong = [];
    const values = {a: 1, c: 3, d: 4, f: 6};
    const floats = new Float32Array(data.buffer);
    let line = 0;
    for (const [key, bucket] of store.buckets) {
      let rows = 0;
      for (let k = 0; k < bucket.lines.length; ++k, ++line) {
        const [first, n] = data.subarray(4 * line);
        rows += n;
        if (floats[4 * line + 2] !== 1.5 || floats[4 * line + 3] !== 7) wrong.push('instant');
        for (let r = first; r < first + n; ++r) {
          if (geometry[16 * r] !== values[key] || geometry[16 * r + 15] !== values[key] ||
              sh[12 * r] !== values[key] || sh[12 * r + 11] !== values[key]) wrong.push(`${key} ${r}`);
        }
      }
      if (rows !== bucket.count) wrong.push(key);
    }
    return {fits, held, ofOthers, tooMany, other: other?.length, count, line, wrong: wrong.slice(0, 5), errors,
            keys: [...store.buckets.keys()].sort()};
  });
  assert.deepEqual(result, {fits: [true, true, true, true], held: 100, ofOthers: 0, tooMany: null, other: 5, count: 100, line: 100,
                            wrong: [], errors: [], keys: ['a', 'c', 'd', 'f']});
  await page.close();
});
