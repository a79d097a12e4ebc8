// SPDX-License-Identifier: Apache-2.0
// Those that made a format: SPZ by Niantic, KSPLAT and its viewer; and the validator of glTF by Khronos.
async function validator(load) {
  const { default: gltf } = await load('gltf-validator');
  return {
    glb: async (bytes) => {
      const { issues } = await gltf.validateBytes(bytes);
      // It does not know the extension, nor the names of its attributes; of severity 2 on they are hints.
      const unknown = /attributes\/KHR_gaussian_splatting:/;
      const left = issues.messages.filter(({ code, severity, pointer }) =>
        severity < 2 && !(code === 'MESH_PRIMITIVE_INVALID_ATTRIBUTE' && unknown.test(pointer)));
      if (left.length > 0) throw new Error(JSON.stringify(left));
      return {};
    } };
}

// Its library, which WebAssembly is made of.
async function niantic(load) {
  const { default: create } = await load('@adobe/spz');
  const spz = await create();
  const logistic = (x) => 1 / (1 + Math.exp(-x));
  const read = (to) => async (bytes) => {
    const cloud = spz.loadSpzFromBuffer(bytes, { to });
    const rotation = [];
    for (let i = 0; i < cloud.numPoints; ++i) {
      const [x, y, z, w] = cloud.rotations.subarray(4 * i, 4 * i + 4);
      rotation.push(w, x, y, z);
    }
    return {
      position: cloud.positions, scale: cloud.scales.map(Math.exp), rotation, sh: cloud.sh,
      opacity: cloud.alphas.map(logistic), dc: cloud.colors };
  };
  return { spz, read };
}

export async function parties(load) {
  const { spz, read } = await niantic(load);
  const axes = spz.CoordinateSystem;
  const out = {
    'Niantic SPZ': { spz: read(axes.UNSPECIFIED) }, 'Niantic SPZ, y up': { spz: read(axes.RUB) },
    'glTF validator': await validator(load) };
  const from = axes.UNSPECIFIED;
  for (const version of [2, 3, 4]) {
    // From a file of version 4, of which all numbers are there.
    out[`Niantic SPZ ${version}`] = {
      spz: async (bytes) => {
        const cloud = spz.loadSpzFromBuffer(bytes, { to: from });
        return spz.saveSpzToBuffer(cloud, { version, from, sh1Bits: 8, shRestBits: 8 });
      } };
  }
  globalThis.window ??= globalThis;
  const viewer = await load('@mkkellogg/gaussian-splats-3d');
  for (const level of [0, 1, 2]) {
    out[`GaussianSplats3D ${level}`] = {
      ksplat: async (bytes) => {
        const made = await viewer.PlyLoader.loadFromFileData(bytes.buffer, 1, level, true, 2);
        return new Uint8Array(made.bufferData);
      } };
  }
  return out;
}
