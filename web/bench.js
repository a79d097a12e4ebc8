// SPDX-License-Identifier: Apache-2.0
// usage: node bench.js TOOL SCENE.l4d PAGE.md: measures, and puts tables between the marks of the page.
import {execFileSync} from 'node:child_process';
import {readFileSync, writeFileSync} from 'node:fs';
import {gzipSync} from 'node:zlib';
import {compile} from './core/src/decoder.js';
import {decoderAt} from './test/at-hand.js';
import {launch, newPage, opened, serve} from './test/browser.js';
import {Sorter} from './view/src/sorter.js';

const [tool, scene, pageName] = process.argv.slice(2);
const root = new URL('..', import.meta.url).pathname;
const out = [];
const table = (head, rows) => {
  out.push('', `| ${head.join(' | ')} |`, `|${head.map(() => '---').join('|')}|`,
           ...rows.map(row => `| ${row.join(' | ')} |`));
};
/** Least of some rounds, ms of CPU: other programs on the machine count for little. */
const cpu = (rounds, fn) => {
  let least = Infinity;
  for (let k = 0; k < rounds; ++k) {
    const before = process.cpuUsage();
    fn();
    const {user, system} = process.cpuUsage(before);
    least = Math.min(least, (user + system) / 1000);
  }
  return least;
};

const kilobytes = n => (n / 1000).toFixed(1);
table(['file', 'kB', 'gzip -9, kB'], ['l4d.wasm', 'player.js', 'worker.js', 'sort-worker.js'].map(name => {
  const bytes = readFileSync(`${root}build/web/player/${name}`);
  return [`\`${name}\``, kilobytes(bytes.length), kilobytes(gzipSync(bytes, {level: 9}).length)];
}));

const bytes = readFileSync(scene);
const wasm = await compile(readFileSync(`${root}build/web/player/l4d.wasm`));
const {decoder} = await decoderAt(wasm, bytes, 0, {whole: true});
decoder.select(0);
const {numGaussians} = decoder.info();
const inNode = cpu(9, () => decoder.decode());
const {decoder: middle, loads} = await decoderAt(wasm, bytes, 0.5);
middle.select(0);
const rows = cpu(5, () => loads.forEach(b => middle.rows(b.layer, b.bucket, 0)));
/** CPU of a command of the tool, ms. @param {string[]} words */
const cpuOfTool = words => Math.min(...Array.from({length: 9}, () => {
  const line = execFileSync('bash', ['-c', 'TIMEFORMAT="%U %S"; { time "$0" "$@" >/dev/null 2>&1; } 2>&1', tool, ...words]);
  return 1000 * line.toString().split(' ').reduce((sum, seconds) => sum + Number(seconds), 0);
}));
const native = cpuOfTool(['decode', scene, '--digest', '--threads', '1', '-q']) - cpuOfTool(['info', scene, '-q']);
const speed = ms => `${ms.toFixed(0)} (${(numGaussians / ms / 1000).toFixed(2)} M Gaussians/s)`;
table([`${numGaussians.toLocaleString('en')} Gaussians, one thread`, 'ms of CPU'], [
  ['decode all, node', speed(inNode)], ['decode all, native (`decode --digest`, less `info`)', speed(native)],
  ['decode an instant and make rows, node', rows.toFixed(0)]
]);

table(['sort in a worker', 'ms of CPU'], [200_000, 1_000_000].map(count => {
  const sorter = new Sorter();
  const geometry = new Float32Array(16 * count);
  for (let k = 0; k < geometry.length; ++k) geometry[k] = Math.random();
  sorter.add('0', geometry, new Uint32Array(Math.ceil(count / 256)), 0, 0);
  const sight = {streams: [{stream: 0, time: 0.5, frame: 0}], depth: [0.3, 0.4, 0.8, 1], nearPlane: 0.01};
  const order = sorter.sort(sight);
  return [count.toLocaleString('en'), cpu(9, () => sorter.sort(sight, order)).toFixed(1)];
}));

const browser = await launch();
const network = [];
for (const rate of [20, 50]) {
  const server = await serve({'scene.l4d': scene}, {rate, delay: 50});
  const page = await newPage(browser);
  await page.route('**/blank.html', route => route.fulfill({contentType: 'text/html', body: '<!doctype html>'}));
  await page.goto(`${server.url}blank.html`);
  const result = await page.evaluate(async () => {
    const {open} = await import('/player.js');
    const began = performance.now();
    const movie = await open('/scene.l4d');
    const opened = performance.now() - began;
    await movie.seek(movie.timeBegin);
    const base = performance.now() - began;
    while (movie.ready.detail !== 'full') await new Promise(r => setTimeout(r, 5));
    const full = performance.now() - began;
    movie.dispose();
    return {opened, base, full};
  });
  network.push([`${rate} Mbit/s, 50 ms`, ...['opened', 'base', 'full'].map(k => result[k].toFixed(0))]);
  await page.close();
  server.close();
}
table(['loopback', 'open, ms', 'base colours, ms', 'all, ms'], network);

const server = await serve({'scene.l4d': scene});
const page = await newPage(browser, {viewport: {width: 320, height: 180}});
await page.goto(server.url);
await opened(page);
const frames = await page.evaluate(async () => {
  const {view, movie} = document.querySelector('l4d-player');
  movie.pause();
  const times = [];
  for (let k = 0; k < 15; ++k) {
    view.orbit.orbit(0.02, 0);
    view.change();
    await view.settled();
    times.push(view.stats.drawMs);
  }
  return {ms: times.sort((a, b) => a - b)[7], visible: view.stats.visible};
});
table(['a frame outside the GPU', 'ms'], [[`${frames.visible.toLocaleString('en')} visible, median of 15`, frames.ms.toFixed(2)]]);
await browser.close();
server.close();

const text = readFileSync(pageName).toString();
const [begin, end] = ['<!-- measured -->', '<!-- end -->'];
writeFileSync(pageName, `${text.slice(0, text.indexOf(begin) + begin.length)}\n${out.join('\n').trim()}\n\n${text.slice(text.indexOf(end))}`);
console.log(out.join('\n'));
