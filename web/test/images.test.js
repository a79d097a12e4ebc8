// SPDX-License-Identifier: Apache-2.0
// The view against `l4dcodec render`: 5 times x 3 cameras x 7 scenes, both targets, both back ends. Each time with one
// camera and at a quarter of the size, one target for each scene but one, and two of the cases of WebGPU, unless
// L4D_WEB_VIEWS is `all` (./dev web, ./dev nightly): browsers draw on the processor here.
import assert from 'node:assert/strict';
import {execFileSync} from 'node:child_process';
import {existsSync, readFileSync, writeFileSync} from 'node:fs';
import {join} from 'node:path';
import {after, before, test} from 'node:test';
import {blankPage, browserName, complaints, hasWebGpu, launch, serve, work} from './browser.js';

const tool = /** @type {string} */ (process.env.L4D_TOOL);
const data = process.env.L4D_DATA_DIR ?? join(process.env.L4D_ROOT ?? '.', '../shared/data');
const allViews = process.env.L4D_WEB_VIEWS === 'all';
const scale = allViews ? 1 : 0.25, width = 640 * scale, height = 360 * scale;
// Of both back ends: several streams at a time, and all that a stream states of how it is drawn; both targets. What a
// target changes has nothing to do with the scene, so that the others are drawn to one of them.
const always = ['members, 16f', 'drawn, 10'];
// dB, of the whole picture. Mesa draws for Firefox on the processor, and less exactly: of the trained scene it reaches 45.2 and
// 38.7 dB, in Chromium, too.
const least = browserName === 'Firefox' ? {'16f': 45, 10: 38} : {'16f': 48, 10: 45};
// Of one back end against the other: dB, and levels of 255 of any channel of any pixel. They sort by 22 and by 32 bits of
// depth, so that some Gaussians of nearly the same depth change places.
const leastAgreement = 60;
const mostDifference = 16;

/** A camera of 640 x 360 at `eye` that looks at `target`, y down. */
const lookAt = (eye, target, focal) => {
  const unit = v => v.map(c => c / Math.hypot(...v));
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const forward = unit(target.map((t, k) => t - eye[k]));
  const right = unit(cross(forward, [0, -1, 0]));
  const axes = [right, cross(forward, right), forward];
  const rows = axes.map(a => [...a, -a.reduce((s, c, k) => s + c * eye[k], 0)]);
  return {K: [[focal, 0, 320], [0, focal, 180], [0, 0, 1]], w2c: [...rows, [0, 0, 0, 1]]};
};

/** Scenes: a real one where it is. */
const scenes = () => {
  const made = [lookAt([0, -1, -9], [0, 0, 0], 420), lookAt([7, -2, 4], [0, 0, 0], 420), lookAt([0.5, 0, -2], [0, 0, 1], 300)];
  const list = [{name: 'long', cameras: made, times: [0.01, 3, 9.5, 14.2, 19.9]}];
  // Each frame is another set of Gaussians: on its time and, as the time of a player is, between.
  list.push({name: 'frames', cameras: made, times: [0, 7 / 30, 14.5 / 30, 29 / 30, 1]});
  // Of several streams: a standing one and others that follow each other; and streams that have nothing in common.
  // Standing positions lie in a coarse grid: seen from simple directions, thousands have the same depth.
  const askew = [lookAt([0.31, -1.17, -9.03], [0, 0, 0], 420), lookAt([7.13, -2.07, 4.21], [0, 0, 0], 420),
                 lookAt([0.53, 0.11, -2.03], [0, 0, 1], 300)];
  list.push({name: 'members', playlist: true, cameras: askew, times: [0, 0.999, 2.5, 5, 7.9]});
  list.push({name: 'joined', playlist: true, cameras: made, times: [0.5, 1.01, 3, 4.9, 9]});
  // They state how they want to be drawn.
  list.push({name: 'dilated', cameras: made, times: [0, 0.3, 0.5, 0.7, 1]});
  list.push({name: 'drawn', cameras: made, times: [0, 0.3, 0.5, 0.7, 1]});
  const trained = join(data, 'basketball/basketball.ply');
  if (existsSync(trained)) {
    const stream = join(work, 'basketball.l4d');
    if (!existsSync(stream)) execFileSync(tool, ['encode', trained, '-q', '-f', '-o', stream]);
    const all = JSON.parse(readFileSync(join(data, 'basketball/cameras.json')).toString()).cameras;
    const times = allViews ? [0, 1.2, 2.5, 3.7, 4.9] : [0, 2.5, 4.9];
    list.push({name: 'basketball', cameras: [0, 10, 15].map(id => all.find(c => c.id === id)), times});
  } else {
    console.log(`SKIPPED: images of basketball: no ${trained}; a second made scene instead`);
    list.push({name: 'short', cameras: made, times: [0, 1, 2, 3, 3.9]});
  }
  for (const scene of list) {
    scene.cameras = scene.cameras.map(({K, w2c}) => ({w2c, K: K.map((row, k) => k < 2 ? row.map(v => v * scale) : row)}));
  }
  return list;
};

let browser, server, page;
before(async () => {
  browser = await launch({webgpu: true});
  const files = scenes().flatMap(({name, playlist}) => playlist ? [`${name}.l4d`, `${name}.m3u8`] : [`${name}.l4d`]);
  server = await serve(Object.fromEntries(files.map(name => [name, join(work, name)])));
  page = await blankPage(browser, server.url);
});
after(async () => {
  await browser?.close();
  server?.close();
});

const made = new Set();
/** The picture of the tool, made once. */
const reference = (scene, k, id) => {
  const png = join(work, `${scene.name}.${k}.${id}.png`);
  const cameraFile = join(work, `${scene.name}.cameras.json`);
  if (!made.has(png)) {
    writeFileSync(cameraFile, JSON.stringify({
      fps: 30, width, height, frames: 150,
      cameras: scene.cameras.map((c, id) => ({id, split: 'test', K: c.K, w2c: c.w2c}))
    }));
    execFileSync(tool, ['render', join(work, `${scene.name}.l4d`), '--cameras', cameraFile, '--camera', String(id),
                        '--time', String(scene.times[k]), '-q', '-f', '-o', png]);
    made.add(png);
  }
  return readFileSync(png).toString('base64');
};

/** Shows a scene in the page with a new view; returns what draws. */
const show = (scene, options) => page.evaluate(async ({url, width, height, options}) => {
  const {open, View} = await import('/player.js');
  const canvas = Object.assign(document.createElement('canvas'), {width, height});
  document.body.replaceChildren(canvas);
  globalThis.view?.dispose();
  globalThis.movie?.dispose();
  globalThis.movie = await open(url);
  globalThis.view = new View(canvas, {...options, exact: true});
  // Looks away while rows come, since each that come make another picture.
  globalThis.away = {worldToCamera: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, -1e6], fx: 1, fy: 1, cx: 0, cy: 0, nearPlane: 0.01};
  globalThis.view.setCamera(globalThis.away);
  await globalThis.view.show(globalThis.movie);
  return globalThis.view.backend;
}, {url: `${server.url}${scene.name}.${scene.playlist ? 'm3u8' : 'l4d'}`, width, height, options});

/** @param {number[]} values */
const summary = values => `${Math.min(...values).toFixed(2)} dB at least, ` +
  `${(values.reduce((a, b) => a + b, 0) / values.length).toFixed(2)} on average`;

for (const scene of scenes()) {
  for (const target of /** @type {const} */ (['16f', '10'])) {
    for (const backend of /** @type {const} */ (['webgl2', 'webgpu'])) {
      const name = `${scene.name}, ${target}, ${backend}`;
      const hasBoth = allViews || always.includes(`${scene.name}, ${target}`);
      const skip = (backend === 'webgpu' || target === '10') && !hasBoth ? 'L4D_WEB_VIEWS=all (./dev web)' : undefined;
      if (skip) console.log(`SKIPPED: images of ${name}: ${skip}`);
      test(`${name}: ${least[target]} dB in each of ${scene.times.length * (allViews ? 3 : 1)} views`, {skip}, async t => {
        if (backend === 'webgpu' && !await hasWebGpu(page)) return t.skip('no WebGPU');
        assert.equal(await show(scene, {target, backend}), backend);
        const found = [], agreement = [], differences = [];
        for (const [k, time] of scene.times.entries()) {
          for (const [id, camera] of scene.cameras.entries()) {
            if (!allViews && id !== k % 3) continue;
            const result = await page.evaluate(compare, {
              time, png: reference(scene, k, id), name: hasBoth ? `${scene.name} ${target} ${k} ${id}` : '',
              camera: {worldToCamera: camera.w2c.flat(), fx: camera.K[0][0], fy: camera.K[1][1], cx: camera.K[0][2],
                       cy: camera.K[1][2], nearPlane: 0.02}
            });
            found.push(result.psnr);
            if (result.other) {
              agreement.push(result.other.psnr);
              differences.push(result.other.most);
            }
          }
        }
        console.log(`${name}: ${summary(found)}`);
        assert.deepEqual(await complaints(page), []);
        assert.ok(Math.min(...found) >= least[target], found.map(v => v.toFixed(2)).join(' '));
        if (agreement.length === 0) return;
        console.log(`${name} against the other back end: ${summary(agreement)}, at most ${Math.max(...differences)} levels`);
        assert.ok(Math.min(...agreement) >= leastAgreement, agreement.map(v => v.toFixed(2)).join(' '));
        assert.ok(Math.max(...differences) <= mostDifference, differences.join(' '));
      });
    }
  }
}

/** In the page: PSNR of the view against a PNG, and against another view that was shown under this name; '': there is none. */
async function compare({time, png, camera, name}) {
  const {view, movie, away} = /** @type {any} */ (globalThis);
  await movie.seek(time);
  await new Promise(resolve => {
    const check = () => {
      if (movie.ready.detail !== 'full') return;
      end();
      resolve(undefined);
    };
    const end = movie.on('ready', check);
    check();
  });
  view.setCamera(camera);
  const got = await view.pixels();
  view.setCamera(away);
  const bitmap = await createImageBitmap(await (await fetch(`data:image/png;base64,${png}`)).blob());
  const context = new OffscreenCanvas(bitmap.width, bitmap.height).getContext('2d');
  context.drawImage(bitmap, 0, 0);
  const wanted = context.getImageData(0, 0, bitmap.width, bitmap.height).data;
  const difference = other => {
    let sum = 0, most = 0;
    for (let k = 0; k < got.length; ++k) {
      if (k % 4 === 3) continue;
      sum += (other[k] - got[k]) ** 2;
      most = Math.max(most, Math.abs(other[k] - got[k]));
    }
    return {psnr: 10 * Math.log10(255 * 255 / Math.max(sum / (got.length / 4 * 3), 1e-9)), most};
  };
  const pictures = (/** @type {any} */ (globalThis).pictures ??= new Map());
  const other = pictures.get(name);
  pictures.delete(name);
  if (!other && name) pictures.set(name, got);
  return {psnr: difference(wanted).psnr, other: other ? difference(other) : null};
}
