// SPDX-License-Identifier: Apache-2.0
// web/network.js over the server of the tool: the whole way of a movie, in node.
import assert from 'node:assert/strict';
import {execFileSync, spawnSync} from 'node:child_process';
import {readFileSync} from 'node:fs';
import {test} from 'node:test';
import {openInNode} from '../../test/node-movie.js';
import {streamOf, tool, until} from './fixture.js';
import {serve} from './server.js';

const script = new URL('../../network.js', import.meta.url).pathname;
const wasmPath = /** @type {string} */ (process.env.L4D_WASM);

test('the table of links has a row for each', t => {
  if (/no HTTP server/.test(spawnSync(tool, ['serve', '.', '--port', '99999']).stderr.toString())) {
    return t.skip('the tool has no HTTP server');
  }
  const env = {...process.env, L4D_PLAY: '1', L4D_LINKS: '100:5,20:20'};
  const rows = execFileSync('node', [script, tool, wasmPath, '-', streamOf('tiers')], {env, stdio: ['ignore', 'pipe', 'ignore']})
    .toString().trim().split('\n').slice(2).map(line => line.split('|').map(cell => cell.trim()));
  assert.deepEqual(rows.map(cells => cells.slice(1, 3)), [['tiers', '100 Mbit/s, 5 ms'], ['tiers', '20 Mbit/s, 20 ms']]);
  for (const [, , , first, requests, full, seek, , start] of rows) {
    assert.ok([first, full, start].every(ms => Number(ms) > 0), rows.join('\n'));
    assert.match(requests, /^\d+, \d+$/);
    assert.match(seek, /^\d+ \(\d+\)$/);
  }
});

test('1,000 seeks over a network: as many requests under way as at the beginning, and as much memory', async () => {
  const server = await serve(readFileSync(streamOf('tiers')));
  const movie = await openInNode(server.url, wasmPath);
  try {
    await movie.seek(movie.timeBegin);
    let memory = 0;
    for (let k = 0; k < 1000; ++k) {
      await movie.seek(movie.timeBegin + movie.duration * ((k * 37) % 1000) / 1000);
      if (k !== 100 && k !== 999) continue;
      await movie.refreshStatistics();
      if (k === 100) memory = movie.statistics.memoryBytes;
    }
    assert.ok(movie.statistics.memoryBytes <= memory + 2 ** 20, `${memory} to ${movie.statistics.memoryBytes} bytes`);
    // Those of requests that seeks cancelled close in their time.
    await until(async () => await server.connections() <= 8, 'all connections but 8 to be closed');
  } finally {
    movie.dispose();
    server.close();
  }
});
