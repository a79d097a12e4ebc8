// SPDX-License-Identifier: Apache-2.0
// A file of several streams as it was while it was recorded.
import {appendFileSync, readFileSync, renameSync, writeFileSync} from 'node:fs';
import {join} from 'node:path';

/**
 * @param {string} finished path of a playlist and its file, without extension @param {string} folder to record in
 * @param {string} [name] of both
 */
export const recording = (finished, folder, name = 'live') => {
  const bytes = readFileSync(`${finished}.l4d`);
  const own = finished.split('/').at(-1);
  const text = readFileSync(`${finished}.m3u8`).toString().replaceAll(`${own}.l4d`, `${name}.l4d`)
    .replace(/TARGETDURATION:\d+/, 'TARGETDURATION:1');
  const lines = text.split('\n');
  const segments = lines.flatMap((line, k) => line === `${name}.l4d` ? [k] : []);
  const [playlist, file] = [join(folder, `${name}.m3u8`), join(folder, `${name}.l4d`)];
  let written = 0;
  return {
    playlist, file, segments: segments.length,
    /** What is there after so many media members; Infinity: all. @param {number} count */
    publish(count) {
      const part = count < segments.length ?
        `${lines.slice(0, segments[count - 1] + 1).join('\n')}\n`.replace('TYPE:VOD', 'TYPE:EVENT') : text;
      const ends = [...part.matchAll(/(\d+)@(\d+)/g)].map(m => Number(m[1]) + Number(m[2]));
      const end = count < segments.length ? Math.max(...ends) : bytes.length;
      appendFileSync(file, bytes.subarray(written, end));
      written = end;
      writeFileSync(`${playlist}.part`, part);
      renameSync(`${playlist}.part`, playlist);
    }
  };
};
