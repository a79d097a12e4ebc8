// SPDX-License-Identifier: Apache-2.0
// usage: L4D_TOOL=TOOL node compare.js PAGE.md [within] [SCENE.l4d CAMERAS.json CAMERA TIME]
// Instants as `l4dcodec render`, the player and Spark draw them: tables between the marks of the page. The views are one
// of the scene that `web/test/run.sh spark` makes in the folder L4D_WORK, from outside; with `within`, another from
// within it, where large splats cover the picture many times; and one of a given scene.
import {execFileSync} from 'node:child_process';
import {readFileSync, writeFileSync} from 'node:fs';
import {join} from 'node:path';
import {launch, newPage, serve, work} from '../test/browser.js';
import {madeCameras, openExample, rendered, tool} from '../test/engine-page.js';

const [pageName, ...rest] = process.argv.slice(2);
const within = rest[0] === 'within';
const [scene, camerasName, cameraId, atTime] = rest.slice(within ? 1 : 0);
const browser = await launch();

/** Causes in the order in which they are mended. */
const causes = [
  ['precision', 'base colours and accumulated splats in 8 bits and within [0, 1] (`extSplats`, `accumExtSplats`)'],
  ['dilation', 'dilation that makes splats more transparent (`blurAmount`, `preBlurAmount`)'],
  ['cut', 'cut-off at 2.83 standard deviations and at 0.5/255 (`maxStdDev`, `minAlpha`)'],
  ['order', 'sorted by distance, not by depth (`sortRadial`)'],
  ['slope', 'no limit of the affine approximation (vertex shader)'],
  ['reach', 'no splat with a centre beside the picture, none above 512 pixels (`clipXY`, `maxPixelRadius`)'],
  ['opaque', 'opacity up to 1, not 0.999 (fragment shader)'],
  ['float', 'blending in 8 bits (a target of 16-bit floats)']
];

/** In the page: PSNR of one way to draw. `mended`: names of causes. */
async function draw({mended, source, extra, camera, size: [width, height], time, png}) {
  const {tools, example} = /** @type {any} */ (globalThis);
  const {THREE, scene, SparkRenderer, SplatMesh, followRules, renderer, splats, mesh, movie} = example;
  mesh.visible = false;
  const has = name => mended.includes(name);
  scene.remove(example.spark);
  splats.removeFromParent();
  // One renderer and one mesh for each way to hold splats: making them takes longer than drawing.
  const options = {
    renderer, enableLod: false, accumExtSplats: has('precision') || source === 'stream', covSplats: source === 'stream', ...extra.renderer
  };
  const made = example.made ??= new Map();
  const once = async (key, make) => {
    if (!made.has(key)) made.set(key, await make());
    return made.get(key);
  };
  const {spark, before, vertexShader, fragmentShader} = await once(
    `spark ${options.accumExtSplats} ${options.covSplats} ${JSON.stringify(extra.renderer)}`, () => {
      const spark = new SparkRenderer(options);
      const {vertexShader, fragmentShader} = spark.material;
      return {spark, before: {...spark}, vertexShader, fragmentShader};
    });
  Object.assign(spark.material, {vertexShader, fragmentShader});
  if (!followRules(spark)) throw new Error('Spark has other shaders');
  const undo = (name, ...keys) => { if (!has(name)) for (const key of keys) spark[key] = before[key]; };
  undo('dilation', 'blurAmount', 'preBlurAmount');
  undo('cut', 'maxStdDev', 'minAlpha');
  undo('order', 'sortRadial');
  undo('reach', 'clipXY', 'maxPixelRadius');
  if (!has('slope')) spark.material.vertexShader = vertexShader;
  if (!has('opaque')) spark.material.fragmentShader = fragmentShader;
  scene.add(spark);
  tools.look(camera, width, height);
  let object = splats;
  if (source === 'stream') {
    splats.rotation.x = 0;
    await tools.seek(time);
  } else {
    const splatOptions = {extSplats: has('precision') && !extra.splatEncoding, splatEncoding: extra.splatEncoding};
    object = await once(`mesh ${JSON.stringify(splatOptions)} ${options.accumExtSplats}`,
                        () => new SplatMesh({url: 'frame.ply', ...splatOptions}).initialized);
  }
  // A change that Spark does not see: the order.
  object.updateVersion();
  scene.add(object);
  let target = null;
  if (has('float')) {
    target = new THREE.WebGLRenderTarget(width, height, {type: THREE.HalfFloatType});
    // Else three.js has Spark convert colours for blending in linear light.
    if (!extra.linear) THREE.ColorManagement.workingColorSpace = THREE.SRGBColorSpace;
  }
  const pixels = await tools.picture(spark, target);
  if (extra.linear) {
    for (let k = 0; k < pixels.length; ++k) {
      const v = pixels[k] / 255;
      pixels[k] = 255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055);
    }
  }
  THREE.ColorManagement.workingColorSpace = THREE.LinearSRGBColorSpace;
  target?.dispose();
  scene.remove(spark);
  object.removeFromParent();
  return tools.psnr(pixels, png);
}

/** The player's view of the same. */
const ofPlayer = async (stream, target, {camera, size: [width, height], time, png}) => {
  const server = await serve({'scene.l4d': stream});
  const page = await newPage(browser);
  await page.route('**/blank.html', route => route.fulfill({contentType: 'text/html', body: '<!doctype html><body>'}));
  await page.goto(`${server.url}blank.html`);
  const psnr = await page.evaluate(async ({camera: {K, w2c}, width, height, time, png, target}) => {
    const {open, View} = await import(/** @type {any} */ ('/player.js'));
    const canvas = Object.assign(document.createElement('canvas'), {width, height});
    document.body.replaceChildren(canvas);
    const movie = await open('/scene.l4d');
    const view = new View(canvas, {target, exact: true});
    view.setCamera({worldToCamera: w2c.flat(), fx: K[0][0], fy: K[1][1], cx: K[0][2], cy: K[1][2], nearPlane: 0.02});
    view.show(movie);
    await movie.seek(time);
    while (movie.ready.detail !== 'full') await new Promise(resolve => setTimeout(resolve, 5));
    const got = await view.pixels();
    const bitmap = await createImageBitmap(await (await fetch(`data:image/png;base64,${png}`)).blob());
    const context = /** @type {any} */ (new OffscreenCanvas(width, height).getContext('2d'));
    context.drawImage(bitmap, 0, 0);
    const wanted = context.getImageData(0, 0, width, height).data;
    const sum = wanted.reduce((s, v, k) => s + (k % 4 === 3 ? 0 : (v - got[k]) ** 2), 0);
    return 10 * Math.log10(255 ** 2 / (sum / (3 * width * height)));
  }, {camera, width, height, time, png, target});
  await page.close();
  server.close();
  return psnr;
};

const all = causes.map(([key]) => key);
const inEight = all.slice(0, -1);
const without = (...keys) => all.filter(key => !keys.includes(key));
const encoding = {rgbMin: 0, rgbMax: 1, lnScaleMin: -12, lnScaleMax: 9, sh1Max: 1, sh2Max: 1, sh3Max: 1, lodOpacity: false};
/** Words, source, what is mended, and other options. @type {[string, string, string[], any][]} */
const mended = [['nothing', 'ply', [], {}], ...causes.map(([, words], k) => [words, 'ply', all.slice(0, k + 1), {}])];
/** @type {[string, string, string[], any][]} */
const but = causes.map(([key, words]) => [words, 'ply', without(key), {}]);
/** @type {[string, string, string[], any][]} */
const others = [
  ['`l4dcodec-spark`, without `followRules`', 'stream', ['precision'], {}],
  ['`l4dcodec-spark`, `ruleOptions` alone', 'stream', without('slope', 'opaque', 'float'), {}],
  ['`l4dcodec-spark`, `followRules`', 'stream', inEight, {}],
  ['`l4dcodec-spark`, `followRules`, 16-bit floats', 'stream', all, {}],
  ['PLY, all mended, base colours in 8 bits of [0, 1]', 'ply', all, {splatEncoding: encoding}],
  ['PLY, all mended, base colours in 8 bits of [-1, 2]', 'ply', all, {splatEncoding: {...encoding, rgbMin: -1, rgbMax: 2}}],
  ['PLY, all mended but floats, `premultipliedAlpha: false`', 'ply', inEight, {renderer: {premultipliedAlpha: false}}],
  ['PLY, all mended, blended in linear light', 'ply', all, {linear: true}]
];

/** All figures of a view, as text. @param {string} name @param {any} camera @param {[number, number]} size @param {number} time */
const measure = async (name, {K, w2c}, size, time) => {
  const frame = join(work, 'frame.ply');
  execFileSync(tool, ['slice', name, '--time', String(time), '-q', '-f', '-o', frame]);
  const view = {camera: {K, w2c}, size, time, png: rendered(name, {K, w2c}, time, size)};
  const server = await serve({'scene.l4d': name, 'frame.ply': frame}, {}, 'build/web/spark');
  const page = await openExample(browser, server.url);
  const found = new Map();
  for (const target of ['16f', '10']) found.set(target, (await ofPlayer(name, target, view)).toFixed(1));
  for (const [, source, list, extra] of [...mended, ...others, ...but]) {
    const key = JSON.stringify([source, list, extra]);
    const began = performance.now();
    const psnr = found.get(key) ?? (await page.evaluate(draw, {mended: list, source, extra, ...view})).toFixed(1);
    found.set(key, psnr);
    console.error(`${psnr} dB, ${((performance.now() - began) / 1000).toFixed(0)} s: ${key}`);
  }
  if (page.errors.length > 0) throw new Error(page.errors.join('\n'));
  await page.close();
  server.close();
  return found;
};

/** Puts the tables into the page. @param {[string, Map<string, string>][]} columns */
const write = columns => {
  const table = (head, ways) => [
    `| ${[head, ...columns.map(([words]) => words)].join(' | ')} |`, `|---|${columns.map(() => '---:|').join('')}`,
    ...ways.map(([words, ...key]) => {
      const cells = columns.map(([, found]) => found.get(key.length > 1 ? JSON.stringify(key) : key[0]));
      return `| ${[words, ...cells].join(' | ')} |`;
    }), ''
  ];
  const out = [
    ...table('our own players and the adapter, dB', [['`l4dcodec-player`, 16-bit floats', '16f'], ['`l4dcodec-player`, 10 bits', '10'], ...others.slice(0, 4)]),
    ...table('PLY in Spark, mended to here, dB', mended), ...table('PLY in Spark, all mended but this, dB', but),
    ...table('PLY in Spark, other settings, dB', others.slice(4))
  ].join('\n');
  const text = readFileSync(pageName).toString();
  const [begin, end] = ['<!-- measured -->', '<!-- end -->'];
  writeFileSync(pageName, `${text.slice(0, text.indexOf(begin) + begin.length)}\n${out}\n${text.slice(text.indexOf(end))}`);
};

const made = join(work, 'short.l4d');
/** @type {[string, Map<string, string>][]} */
const columns = [['made, from outside', await measure(made, madeCameras[1], [320, 240], 3)]];
write(columns);
if (scene) {
  const {width, height, cameras} = JSON.parse(readFileSync(camerasName).toString());
  columns.push(['trained', await measure(scene, cameras.find(c => c.id === Number(cameraId)), [width, height], Number(atTime))]);
  write(columns);
}
if (within) {
  columns.push(['made, from within', await measure(made, madeCameras[2], [320, 240], 3)]);
  write(columns);
}
await browser.close();
