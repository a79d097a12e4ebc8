// SPDX-License-Identifier: Apache-2.0
// The types of the packages, as a program in TypeScript sees them.
import assert from 'node:assert/strict';
import {spawnSync} from 'node:child_process';
import {mkdtempSync, rmSync, writeFileSync} from 'node:fs';
import {tmpdir} from 'node:os';
import {join} from 'node:path';
import {test} from 'node:test';

const root = process.env.L4D_ROOT ?? new URL('../..', import.meta.url).pathname;

/** What the compiler says of a program. @param {string} program */
const complaints = program => {
  const folder = mkdtempSync(join(tmpdir(), 'l4dtypes-'));
  try {
    writeFileSync(join(folder, 'program.ts'), program);
    const types = name => [join(root, 'build/web', name)];
    writeFileSync(join(folder, 'tsconfig.json'), JSON.stringify({
      compilerOptions: {
        target: 'ES2022', module: 'ESNext', moduleResolution: 'bundler', lib: ['ES2023', 'DOM', 'DOM.Iterable'], types: [],
        strict: true, noEmit: true, paths: {l4dcodec: types('l4dcodec'), 'l4dcodec-player': types('l4dcodec-player')}
      }
    }));
    const {stdout} = spawnSync(join(root, 'web/node_modules/.bin/tsc'), ['-p', folder], {encoding: 'utf8'});
    return stdout.trim();
  } finally {
    rmSync(folder, {recursive: true});
  }
};

test('documents know <l4d-player>, its properties and what they hold', () => {
  assert.equal(complaints(`
    import {open, View} from 'l4dcodec-player';
    const player = document.querySelector('l4d-player')!;
    const made = document.createElement('l4d-player');
    const seconds: number = player.currentTime + made.duration;
    const played: Promise<void> = player.play();
    player.src = 'scene.l4d';
    player.loop = !player.paused;
    const loaded: Promise<void> = made.load(new Blob());
    const playback: 'once' | 'loop' | 'ping-pong' | null | undefined = player.movie?.info.presentation.playback;
    const show = async (view: View) => view.show(await open('scene.l4d'));
    export {loaded, playback, played, seconds, show};
  `), '');
  assert.match(complaints("document.querySelector('l4d-player')!.loop = 'yes'; import 'l4dcodec-player'; export {};"),
               /not assignable to type 'boolean'/);
});
