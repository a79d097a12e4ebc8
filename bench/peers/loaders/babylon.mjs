// SPDX-License-Identifier: Apache-2.0
// The loaders of Babylon.js, without a renderer. Of what they read, all but positions and scales are
// bytes, rotations too.
export async function parties(load) {
  globalThis.window ??= globalThis;
  const core = await load('@babylonjs/core');
  const { SPLATFileLoader } = await load('@babylonjs/loaders');
  const fflate = await load('fflate');
  const scene = new core.Scene(new core.NullEngine());
  scene.useRightHandedSystem = true;
  // What goes to textures, before it goes there.
  let taken = [];
  const { prototype } = core.GaussianSplattingMesh;
  prototype.updateData = function (data, sh, options, parts, degree) {
    taken.push({ mesh: this, data, sh, degree: degree ?? 0 });
  };
  prototype.updateDataAsync = async function (data, sh, parts, degree) {
    taken.push({ mesh: this, data, sh, degree: degree ?? 0 });
  };

  const values = ({ mesh, data, sh, degree }, world) => {
    const bytes = new Uint8Array(data), floats = new Float32Array(data), count = bytes.length / 32;
    const terms = (degree + 1) ** 2 - 1;
    const out = { position: [], scale: [], rotation: [], base: [], opacity: [], sh: [] };
    for (let i = 0; i < count; ++i) {
      out.position.push(...floats.subarray(8 * i, 8 * i + 3));
      out.scale.push(...floats.subarray(8 * i + 3, 8 * i + 6));
      for (let k = 0; k < 3; ++k) out.base.push(bytes[32 * i + 24 + k] / 255);
      out.opacity.push(bytes[32 * i + 27] / 255);
      for (let k = 0; k < 4; ++k) out.rotation.push((bytes[32 * i + 28 + k] - 127.5) / 127.5);
      for (let k = 0; k < 3 * terms; ++k) out.sh.push((sh[k >> 4][16 * i + k % 16] - 128) / 128);
    }
    if (world) out.world = mesh.computeWorldMatrix(true).asArray();
    return out;
  };
  const one = (world) => {
    if (taken.length !== 1) throw new Error(`${taken.length} objects of splats`);
    return values(taken.pop(), world);
  };
  const glb = async (bytes) => {
    await core.ImportMeshAsync(bytes, scene, { pluginExtension: '.glb' });
    return one(true);
  };
  const read = async (bytes) => {
    // Without a library for SPZ, which only a page can load: the loader then reads versions 2 and 3 by itself.
    await new SPLATFileLoader({ fflate, spzLibraryUrl: '' }).importMeshAsync('', scene, bytes.buffer, '');
    return one(false);
  };
  // The axes of other formats than glTF are for a viewer to turn.
  return {
    'Babylon.js': { glb, ply: read, 'compressed.ply': read, splat: read, spz: read } };
}
