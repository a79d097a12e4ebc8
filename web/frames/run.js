// SPDX-License-Identifier: Apache-2.0
// usage: node web/frames/run.js [--serve] [--gpu] [NAME=VALUE]...
// Measures frames of both back ends in headless Chromium and prints a table. --gpu: on the GPU, where Chromium finds one
// over EGL; otherwise on the processor, whose frame times say little. --serve: prints an address for a browser of
// yours, which shows the table. Of what: counts=150000,500000,1000000 size=1920x1080 frames=60
// backends=webgl2,webgpu
import {cpSync} from 'node:fs';
import {launch, newPage, serve} from '../test/browser.js';

const words = process.argv.slice(2);
const root = new URL('../..', import.meta.url).pathname;
const query = words.filter(word => word.includes('=')).join('&');
cpSync(`${root}web/frames`, `${root}build/web/frames`, {recursive: true});
const files = await serve({}, {}, 'build/web');
const address = `${files.url}frames/index.html?${query}`;
if (words.includes('--serve')) {
  console.log(`${address}\nCtrl-C ends`);
} else {
  const browser = await launch({webgpu: true, gpu: words.includes('--gpu')});
  const page = await newPage(browser);
  await page.goto(address);
  const measured = await (await page.waitForFunction(() => globalThis.measured, undefined, {timeout: 0})).jsonValue();
  await browser.close();
  files.close();
  const lines = [
    `Drawn by ${measured.rows[0]?.device || 'an unknown device'}:`, '',
    '| back end | seen | page, ms of a frame | sort in a worker, ms | from frame to frame, ms |', '|---|---|---|---|---|',
    ...measured.rows.map(({backend, visible, cpu, sort, frame}) => `| ${backend} | ${visible.toLocaleString('en')} | ` +
      `${cpu.toFixed(2)} | ${sort?.toFixed(1) ?? 'on the GPU'} | ${frame.toFixed(1)} |`)
  ];
  console.log(lines.join('\n'));
  if (measured.error) throw new Error(measured.error);
}
