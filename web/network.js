// SPDX-License-Identifier: Apache-2.0
// usage: node network.js TOOL WASM PAGE.md STREAM.l4d...
// Plays streams with web/core over links of different speed, which `TOOL serve` makes, and puts a table of what that
// costs between the marks of the page. L4D_PLAY=SECONDS: of playback (60). L4D_LINKS=20:50,5:100: these links alone.
import {spawn} from 'node:child_process';
import {once} from 'node:events';
import {readFileSync, writeFileSync} from 'node:fs';
import {basename, dirname} from 'node:path';
import {createInterface} from 'node:readline';
import {openInNode} from './test/node-movie.js';

const [tool, wasm, pageName, ...streams] = process.argv.slice(2);
const playSeconds = Number(process.env.L4D_PLAY ?? 60);
const links = process.env.L4D_LINKS?.split(',').map(link => link.split(':').map(Number)) ??
  [5, 20, 100].flatMap(rate => [20, 50, 100].map(delay => [rate, delay]));
const rounds = 3;
const numSeeks = 12;
const sleep = ms => new Promise(resolve => setTimeout(resolve, ms));
const median = values => values.toSorted((a, b) => a - b)[Math.floor(values.length / 2)];

/** The server of a folder behind a link. */
const serve = async (folder, rate, delay) => {
  const server = spawn(tool, ['serve', folder, '--rate', String(rate), '--delay', String(delay), '--json']);
  const [line] = await once(createInterface(server.stdout), 'line');
  return {url: JSON.parse(line).url, close: () => server.kill()};
};

const used = movie => ({...movie.statistics});
/** Waits until the rows of this instant are here in full. */
const whole = async movie => {
  while (!(movie.ready.detail === 'full' && movie.ready.until >= movie.currentTime)) await sleep(2);
};

/** First picture, and all of it where that is wanted. */
const begin = async (url, isWhole = true) => {
  const began = performance.now();
  const movie = await openInNode(url, wasm);
  await movie.seek(movie.timeBegin);
  const first = performance.now() - began;
  await movie.refreshStatistics();
  const {requests, bytes} = used(movie);
  if (isWhole) await whole(movie);
  const full = performance.now() - began;
  return {movie, first, full, requests, bytes};
};

/** Seeks, each when the last picture is whole; of short streams from the beginning each, before the rest has come. */
const seekAround = async (movie, url) => {
  const out = {times: [], requests: 0, bytes: 0};
  const isShort = movie.duration < 60;
  const count = isShort ? numSeeks / 3 : numSeeks;
  for (let k = 0; k < count; ++k) {
    const from = isShort ? (await begin(url)).movie : movie;
    if (!isShort) await sleep(300);
    await from.refreshStatistics();
    const before = used(from);
    const began = performance.now();
    await from.seek(movie.timeBegin + movie.duration * (((7 * k + 3) % count) + 0.5) / count);
    out.times.push(performance.now() - began);
    await from.refreshStatistics();
    out.requests += (used(from).requests - before.requests) / count;
    out.bytes += (used(from).bytes - before.bytes) / count;
    if (isShort) from.dispose();
    else await whole(from);
  }
  return out;
};

/** Plays from the beginning of a fresh movie. */
const play = async url => {
  const opened = performance.now();
  const movie = await openInNode(url, wasm);
  movie.loop = true;
  await movie.seek(movie.timeBegin);
  movie.play();
  // It waits for the next instants before it starts, which is no stall.
  while (movie.currentTime <= movie.timeBegin) await sleep(2);
  const start = performance.now() - opened;
  let stalls = 0, stalled = 0, since = 0;
  movie.on('stall', () => { ++stalls; since = performance.now(); });
  movie.on('resume', () => { if (since > 0) stalled += performance.now() - since; since = 0; });
  const began = performance.now();
  await sleep(1000 * playSeconds);
  if (since > 0) stalled += performance.now() - since;
  const seconds = (performance.now() - began) / 1000;
  await movie.refreshStatistics();
  const {requests, bytes} = used(movie);
  const {tier, detail} = movie.ready;
  movie.dispose();
  return {start, stalls, stalled: stalled / 1000, requests: requests / seconds, bytes: bytes / seconds,
          rung: `${detail}${movie.info.lastTier > 0 ? `, tier ${tier}` : ''}`};
};

const rows = [];
for (const stream of streams) {
  for (const [rate, delay] of links) {
    const server = await serve(dirname(stream), rate, delay);
    const url = server.url + basename(stream);
    const begins = [];
    for (let k = 0; k < rounds; ++k) {
      const one = await begin(url, k === rounds - 1);
      if (k === rounds - 1) one.seeks = await seekAround(one.movie, url);
      one.movie.dispose();
      begins.push(one);
    }
    server.close();
    rows.push({stream, rate, delay, begins, seeks: begins.at(-1).seeks});
    console.error(`${basename(stream)}, ${rate} Mbit/s, ${delay} ms`);
  }
}
// Nine at a time, since they wait most of it.
for (let k = 0; k < rows.length && playSeconds > 0; k += 9) {
  await Promise.all(rows.slice(k, k + 9).map(async (row, i) => {
    // All of them decode most at the beginning.
    await sleep(6000 * i);
    const server = await serve(dirname(row.stream), row.rate, row.delay);
    row.play = await play(server.url + basename(row.stream));
    server.close();
  }));
}

const kilobytes = n => (n / 1000).toFixed(0);
const lines = [
  '| stream | link | first picture, ms | requests, kB | whole picture, ms | a seek, ms: median (most) | requests, kB | plays after, ms | stalls | a second of playback: requests, kB | ends at |',
  '|---|---|---|---|---|---|---|---|---|---|---|'];
for (const {stream, rate, delay, begins, seeks, play: p} of rows) {
  const of = key => median(begins.map(b => b[key]));
  const {full} = begins.at(-1);
  lines.push(`| ${[basename(stream, '.l4d'), `${rate} Mbit/s, ${delay} ms`, of('first').toFixed(0), `${of('requests')}, ${kilobytes(of('bytes'))}`,
    full.toFixed(0), `${median(seeks.times).toFixed(0)} (${Math.max(...seeks.times).toFixed(0)})`,
    `${seeks.requests.toFixed(1)}, ${kilobytes(seeks.bytes)}`,
    p?.start.toFixed(0) ?? '', p ? `${p.stalls}${p.stalls > 0 ? `, ${p.stalled.toFixed(1)} s` : ''}` : '', p ? `${p.requests.toFixed(1)}, ${kilobytes(p.bytes)}` : '', p?.rung ?? ''].join(' | ')} |`);
}
console.log(lines.join('\n'));
if (pageName !== '-') {
  const text = readFileSync(pageName).toString();
  const [from, to] = ['<!-- network -->', '<!-- end of network -->'];
  writeFileSync(pageName, `${text.slice(0, text.indexOf(from) + from.length)}\n${lines.join('\n')}\n\n${text.slice(text.indexOf(to))}`);
}
process.exit(0);
