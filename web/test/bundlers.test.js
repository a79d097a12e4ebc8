// SPDX-License-Identifier: Apache-2.0
// What bundlers make of the packages, in browsers. L4D_BUNDLERS=all, as ./dev web sets it; otherwise esbuild alone.
import assert from 'node:assert/strict';
import {execFileSync} from 'node:child_process';
import {mkdirSync, mkdtempSync, readFileSync, rmSync, writeFileSync} from 'node:fs';
import {createRequire} from 'node:module';
import {tmpdir} from 'node:os';
import {join, relative} from 'node:path';
import {after, before, test} from 'node:test';
import {gzipSync} from 'node:zlib';
import {complaints, launch, newPage, opened, serve, work} from './browser.js';

const root = process.env.L4D_ROOT ?? new URL('../..', import.meta.url).pathname;
const require = createRequire(import.meta.url);
const folder = mkdtempSync(join(tmpdir(), 'l4dbundle-'));
const output = join(folder, 'dist');
let browser, archives;

before(async () => {
  browser = await launch();
  mkdirSync(join(folder, 'node_modules'));
  archives = ['l4dcodec', 'l4dcodec-player'].map(name => {
    const [{filename, files}] = JSON.parse(execFileSync('npm', ['pack', '--json', '--pack-destination', folder, join(root, 'build/web', name)],
                                                         {stdio: ['ignore', 'pipe', 'ignore']}).toString());
    mkdirSync(join(folder, 'node_modules', name));
    execFileSync('tar', ['-xzf', join(folder, filename), '-C', join(folder, 'node_modules', name), '--strip-components=1']);
    return files.map(({path}) => path);
  });
  writeFileSync(join(folder, 'package.json'), '{"type": "module"}');
});
after(async () => {
  await browser?.close();
  rmSync(folder, {recursive: true});
});

/** The page of an application, whose module is `src`. @param {string} src */
const page = src => `<!doctype html><link rel="icon" href="data:,"><l4d-player src="/scene.l4d"></l4d-player><script type="module" src="${src}"></script>`;

/** @type {Record<string, {from: string, build: () => Promise<void>}>} */
const bundlers = {
  esbuild: {from: 'l4dcodec-player/single', build: async () => {
    await require('esbuild').build({entryPoints: [join(folder, 'main.js')], bundle: true, format: 'esm', outdir: output, logLevel: 'error'});
  }},
  rollup: {from: 'l4dcodec-player/single', build: async () => {
    const {rollup} = await import('rollup');
    const {nodeResolve} = await import('@rollup/plugin-node-resolve');
    const bundle = await rollup({input: join(folder, 'main.js'), plugins: [nodeResolve()]});
    await bundle.write({dir: output, format: 'es'});
  }},
  webpack: {from: 'l4dcodec-player', build: async () => {
    const webpack = require('webpack');
    const stats = await new Promise((resolve, reject) => webpack(
      {mode: 'production', context: folder, entry: './main.js', output: {path: output}}, (error, done) => error ? reject(error) : resolve(done)));
    assert.ok(!stats.hasErrors(), stats.toString());
  }},
  vite: {from: 'l4dcodec-player', build: async () => {
    const {build} = await import('vite');
    await build({root: folder, logLevel: 'error', build: {outDir: output, emptyOutDir: true}});
  }}
};

test('archives hold a README, the licence and types', () => {
  for (const files of archives) {
    for (const name of ['README.md', 'LICENSE', 'package.json']) assert.ok(files.includes(name), `${name} of ${files}`);
    assert.ok(files.some(name => /^types\/.*\.d\.ts$/.test(name)));
  }
  assert.ok(archives[1].includes('dist/l4d-player.js'));
});

for (const [name, {from, build}] of Object.entries(bundlers)) {
  test(`${name}: ${from} plays`, {skip: process.env.L4D_BUNDLERS !== 'all' && name !== 'esbuild' && 'L4D_BUNDLERS=all'}, async () => {
    rmSync(output, {recursive: true, force: true});
    writeFileSync(join(folder, 'main.js'), `import '${from}';\n`);
    writeFileSync(join(folder, 'index.html'), page('/main.js'));
    await build();
    if (name !== 'vite') writeFileSync(join(output, 'index.html'), page('main.js'));
    const server = await serve({'scene.l4d': join(work, 'frames.l4d')}, {}, relative(root, output));
    const tab = await newPage(browser);
    try {
      await tab.goto(server.url);
      await opened(tab);
      assert.deepEqual(await complaints(tab), []);
    } finally {
      await tab.close();
      server.close();
    }
  });
}

test('l4d-player.js alone, from another origin, with a content security policy', async () => {
  const cdn = await serve({}, {}, relative(root, join(folder, 'node_modules/l4dcodec-player/dist')), {'Access-Control-Allow-Origin': '*'});
  const server = await serve({'scene.l4d': join(work, 'frames.l4d')}, {page: {body: page(`${cdn.url}l4d-player.js`).replace('/scene.l4d', 'scene.l4d'), headers: {
    'Content-Security-Policy': `default-src 'none'; img-src data:; script-src ${cdn.url} 'wasm-unsafe-eval'; worker-src blob:; connect-src 'self'`}}});
  const tab = await newPage(browser);
  try {
    await tab.goto(`${server.url}page.html`);
    await opened(tab);
    assert.deepEqual(await complaints(tab), []);
    assert.equal(cdn.names.length, 1, `${cdn.names}`);
  } finally {
    await tab.close();
    server.close();
    cdn.close();
  }
});

test('player.js takes at most 50 kB with gzip', () => {
  const {length} = gzipSync(readFileSync(join(root, 'build/web/player/player.js')), {level: 9});
  assert.ok(length <= 50_000, `${length} bytes`);
});
