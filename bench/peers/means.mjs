// SPDX-License-Identifier: Apache-2.0
// Sizes of points by other coders, each checked by decoding.
//
// usage: node means.mjs POINTS OUTPUT_FOLDER
//
// POINTS: x, y, z of each, 16-bit unsigned, little-endian, in Morton order. Prints one JSON
// document; what meshoptimizer makes is also written to the folder, for a general compressor on
// top.
import { readFileSync, writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { pathToFileURL } from 'node:url';
import path from 'node:path';

const [points, folder] = process.argv.slice(2);
// Packages lie beside the results, not beside this file.
const require = createRequire(pathToFileURL(path.resolve(folder, 'package.json')));
const bytes = readFileSync(points);
const xyz = new Uint16Array(bytes.buffer, bytes.byteOffset, bytes.length / 2);
const n = xyz.length / 3;
const results = [];

function add(name, run) {
  const started = performance.now();
  try {
    const row = run();
    results.push({ name, ...row, seconds: (performance.now() - started) / 1000 });
  } catch (error) {
    results.push({ name, skipped: String(error.message ?? error) });
  }
}

// A vertex is a multiple of four bytes: the fourth number is 0.
function vertices(order) {
  const out = new Uint16Array(4 * n);
  for (let i = 0; i < n; ++i) out.set(xyz.subarray(3 * order[i], 3 * order[i] + 3), 4 * i);
  return new Uint8Array(out.buffer);
}

const { MeshoptEncoder, MeshoptDecoder } = require('meshoptimizer');
await Promise.all([MeshoptEncoder.ready, MeshoptDecoder.ready]);

function meshopt(name, order) {
  add(name, () => {
    const source = vertices(order);
    const coded = MeshoptEncoder.encodeVertexBufferLevel(source, n, 8, 3, 1);
    const back = new Uint8Array(source.length);
    MeshoptDecoder.decodeVertexBuffer(back, n, 8, coded);
    if (Buffer.compare(back, source) !== 0) throw new Error('decoded points differ');
    const file = path.join(folder, `${name.replace(/\W+/g, '_')}.bin`);
    writeFileSync(file, coded);
    return { bytes: coded.length, file };
  });
}

meshopt('meshoptimizer, Morton order', Array.from({ length: n }, (_, i) => i));
const remap = MeshoptEncoder.reorderPoints(Float32Array.from(xyz), 3);
const order = new Uint32Array(n);
for (let i = 0; i < n; ++i) order[remap[i]] = i;
meshopt('meshoptimizer, its own order', order);

const draco = require('draco3d');
const [encoding, decoding] = await Promise.all([
  draco.createEncoderModule({}), draco.createDecoderModule({})]);
const sorted = (values) => {
  const keys = new Float64Array(n);
  for (let i = 0; i < n; ++i) {
    keys[i] = values[3 * i] * 2 ** 32 + values[3 * i + 1] * 2 ** 16 + values[3 * i + 2];
  }
  return keys.sort();
};
add('Draco, k-d tree', () => {
  const builder = new encoding.PointCloudBuilder();
  const cloud = new encoding.PointCloud();
  builder.AddUInt16Attribute(cloud, encoding.POSITION, n, 3, xyz);
  const encoder = new encoding.Encoder();
  encoder.SetSpeedOptions(0, 0);
  const out = new encoding.DracoInt8Array();
  const length = encoder.EncodePointCloudToDracoBuffer(cloud, false, out);
  if (length === 0) throw new Error('encoding failed');
  const coded = new Int8Array(length);
  for (let i = 0; i < length; ++i) coded[i] = out.GetValue(i);

  const decoder = new decoding.Decoder();
  const back = new decoding.PointCloud();
  if (!decoder.DecodeArrayToPointCloud(coded, length, back).ok()) {
    throw new Error('decoding failed');
  }
  const attribute = decoder.GetAttributeByUniqueId(back, 0);
  const values = new decoding.DracoUInt16Array();
  decoder.GetAttributeUInt16ForAllPoints(back, attribute, values);
  const decoded = new Uint16Array(3 * n);
  for (let i = 0; i < 3 * n; ++i) decoded[i] = values.GetValue(i);
  const a = sorted(xyz), b = sorted(decoded);
  if (back.num_points() !== n || !a.every((v, i) => v === b[i])) {
    throw new Error('decoded points differ');
  }
  return { bytes: length };
});

console.log(JSON.stringify(results));
