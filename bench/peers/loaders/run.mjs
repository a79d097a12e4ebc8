// SPDX-License-Identifier: Apache-2.0
// Files of splats by programs from npm.
//
// usage: node run.mjs FOLDER JOBS.json
//
// JOBS: a list of {party, format, from, to}, run in order. A party of `readers` puts what it finds in
// the file `from` into the JSON document `to`: flat arrays position, opacity, base (colours from 0 to 1) or dc,
// sh (coefficient by coefficient, r g b, from degree 1 on), and covariance (xx xy xz yy yz zz) or scale
// and rotation (w x y z), and by need world, a matrix by columns. A party of `writers` makes the file
// `to`. Prints a list of what went wrong, null where nothing did.
import { readFileSync, writeFileSync } from 'node:fs';
import { pathToFileURL } from 'node:url';
import path from 'node:path';

const [folder, list] = process.argv.slice(2);
// Packages lie beside the results, not beside this file: what imports them has to lie there, too.
const loader = path.resolve(folder, 'load.mjs');
writeFileSync(loader, 'export default (name) => import(name);\n');
const { default: load } = await import(pathToFileURL(loader));
const modules = { 'three.js': 'three', 'Babylon.js': 'babylon' };
const loaded = {};
const parties = (party) => {
  const name = modules[party] ?? 'others';
  loaded[name] ??= import(`./${name}.mjs`).then((module) => module.parties(load));
  return loaded[name];
};

const plain = (key, value) => (ArrayBuffer.isView(value) ? Array.from(value) : value);
const wrong = [];
for (const { party, format, from, to } of JSON.parse(readFileSync(list))) {
  try {
    const run = (await parties(party))[party]?.[format];
    if (!run) throw new Error('no such program');
    const found = await run(new Uint8Array(readFileSync(from)));
    writeFileSync(to, ArrayBuffer.isView(found) ? found : JSON.stringify(found, plain));
    wrong.push(null);
  } catch (error) {
    wrong.push(String(error.message ?? error));
  }
}
console.log(JSON.stringify(wrong));
process.exit(0);  // whatever timers a renderer has
