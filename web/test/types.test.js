// SPDX-License-Identifier: Apache-2.0
// The types of the packages, as a program in TypeScript sees them.
import assert from 'node:assert/strict';
import {spawnSync} from 'node:child_process';
import {mkdtempSync, rmSync, symlinkSync, writeFileSync} from 'node:fs';
import {tmpdir} from 'node:os';
import {join} from 'node:path';
import {test} from 'node:test';

const root = process.env.L4D_ROOT ?? new URL('../..', import.meta.url).pathname;

/** The oldest one that is promised, and the newest. */
const compilers = ['typescript-5.4', 'typescript'];

/** What a compiler says of a program. @param {string} program @param {string} [compiler] */
const complaints = (program, compiler = 'typescript') => {
  const folder = mkdtempSync(join(tmpdir(), 'l4dtypes-'));
  try {
    writeFileSync(join(folder, 'program.tsx'), program);
    symlinkSync(join(root, 'web/node_modules'), join(folder, 'node_modules'));
    const types = name => [join(root, 'build/web', name)];
    writeFileSync(join(folder, 'tsconfig.json'), JSON.stringify({
      compilerOptions: {
        target: 'ES2022', module: 'ESNext', moduleResolution: 'bundler', lib: ['ES2022', 'DOM', 'DOM.Iterable'], types: [], jsx: 'preserve',
        strict: true, noEmit: true, paths: {
          l4dcodec: types('l4dcodec'), 'l4dcodec-player': types('l4dcodec-player'),
          'l4dcodec-player/splats': types('l4dcodec-player/types/splats.d.ts'),
          'l4dcodec-player/react': types('l4dcodec-player/types/react.d.ts'), react: [join(root, 'web/node_modules/@types/react')]
        }
      }
    }));
    const {stdout} = spawnSync(process.execPath, [join(root, 'web/node_modules', compiler, 'bin/tsc'), '-p', folder], {encoding: 'utf8'});
    return stdout.trim();
  } finally {
    rmSync(folder, {recursive: true});
  }
};

for (const compiler of compilers) test(`${compiler}: documents know <l4d-player>, its properties, events and attributes`, () => {
  assert.equal(complaints(`
    import {L4DPlayer, open, View} from 'l4dcodec-player';
    import {Splats} from 'l4dcodec-player/splats';
    const player = document.querySelector('l4d-player')!;
    const made = document.createElement('l4d-player');
    const seconds: number = player.currentTime + made.duration;
    const played: Promise<void> = player.play();
    player.src = 'scene.l4d';
    player.loop = !player.paused;
    player.textTracks[0].mode = player.addTextTrack('captions', 'English', 'en').mode;
    L4DPlayer.words = {pl: {play: 'Odtwórz'}};
    const loaded: Promise<void> = made.load(new Blob());
    const playback: 'once' | 'loop' | 'ping-pong' | null | undefined = player.movie?.info.presentation.playback;
    const show = async (view: View) => view.show(await open('scene.l4d'));
    const splats = new Splats('scene.l4d', {maxRows: 1000, sortWorker: () => new Worker('sort-worker.js')});
    const still: Promise<boolean> = splats.load().then(movie => movie.paused);
    player.addEventListener('open', ({detail}) => { const frames: number = detail.info.numFrames; void frames; });
    player.addEventListener('error', event => { const code: string = event.detail.code; void code; });
    player.addEventListener('playing', event => { const type: string = event.type; void type; });
    player.options = {request: async ({url}) => ({url: url + '?signed'}), timeout: 3, bases: ['https://a.example/']};
    player.addEventListener('camera-change', ({detail}) => { const source: 'user-interaction' | 'automatic' | 'none' = detail.source; void source; });
    player.addEventListener('enterpictureinpicture', ({pictureInPictureWindow}) => { const width: number = pictureInPictureWindow.width; void width; });
    player.cameraOrbit = String(made.getCameraOrbit());
    player.fieldOfView = null;
    player.autoRotate = made.getCameraTarget().x + made.getFieldOfView() > 0;
    const point: Promise<[number, number, number] | null> = player.queryPosition(1, 2);
    const picture: Promise<Blob> = player.toBlob({type: 'image/webp', width: 640});
    const state: number = player.buffered.end(0) + player.readyState + (player.error?.code ?? 0);
    const attributes: JSX.IntrinsicElements['l4d-player'] = {src: 'a.l4d', loading: 'lazy', preload: 'metadata', 'max-rows': 5, 'camera-orbit': '0deg 75deg 4m', 'auto-rotate': true};
    export {attributes, loaded, picture, playback, played, point, seconds, show, state, still};
  `, compiler), '');
  assert.match(complaints("document.querySelector('l4d-player')!.loop = 'yes'; import 'l4dcodec-player'; export {};", compiler),
               /not assignable to type 'boolean'/);
});

test('React knows <l4d-player> and its attributes', () => {
  const program = (/** @type {string} */ attributes) => `import type * as React from 'react';
    import 'l4dcodec-player/react';
    const element: React.JSX.Element = <l4d-player ${attributes} />;
    export {element};`;
  assert.equal(complaints(program('src="scene.l4d" loading="lazy" camera-target="0 1 0" auto-rotate')), '');
  assert.match(complaints(program('loading="late"')), /late/);
});
