// SPDX-License-Identifier: Apache-2.0
// The loaders of three.js. Colours, opacities and harmonics of theirs are bytes.
const addon = (name) => `three/examples/jsm/loaders/${name}.js`;

// Bands of harmonics lie in words of four bytes, of which the last ones may be unused.
function harmonics(geometry, count) {
  const bands = [1, 2, 3].map((degree) => geometry.getAttribute(`sphericalHarmonics${degree}`));
  const numbers = bands.map((band, k) => (band ? 3 * (2 * k + 3) : 0));
  const all = numbers.reduce((sum, n) => sum + n, 0);
  const out = new Float32Array(count * all);
  let at = 0;
  bands.forEach((band, k) => {
    if (!band) return;
    const bytes = new Uint8Array(band.array.buffer, band.array.byteOffset);
    for (let i = 0; i < count; ++i) {
      for (let j = 0; j < numbers[k]; ++j) {
        out[all * i + at + j] = (bytes[4 * band.itemSize * i + j] - 128) / 128;
      }
    }
    at += numbers[k];
  });
  return out;
}

function values(geometry, world) {
  const colors = geometry.getAttribute('color').array, count = colors.length / 4;
  const base = new Float32Array(3 * count), opacity = new Float32Array(count);
  for (let i = 0; i < count; ++i) {
    for (let k = 0; k < 3; ++k) base[3 * i + k] = colors[4 * i + k] / 255;
    opacity[i] = colors[4 * i + 3] / 255;
  }
  return {
    position: geometry.getAttribute('position').array, opacity, base, sh: harmonics(geometry, count),
    covariance: geometry.getAttribute('covariance').array, world };
}

export async function parties(load) {
  globalThis.self ??= globalThis;
  const [{ GLTFLoader }, { GLTFGaussianSplatLoaderExtension }, ply, spz, splat, ksplat] =
    await Promise.all(['GLTFLoader', 'GLTFGaussianSplatLoaderExtension', 'GaussianSplatPLYLoader',
      'SPZLoader', 'SPLATLoader', 'KSPLATLoader'].map((name) => load(addon(name))));
  const loader = new GLTFLoader();
  loader.register((parser) => new GLTFGaussianSplatLoaderExtension(parser));
  const read = (Loader) => async (bytes) => values(await new Loader().parse(bytes.buffer));
  return {
    'three.js': {
      glb: async (bytes) => {
        const { scene } = await loader.parseAsync(bytes.buffer, '');
        scene.updateMatrixWorld(true);
        const found = [];
        scene.traverse((object) => {
          if (object.splatGeometry) {
            found.push(values(object.splatGeometry, object.matrixWorld.elements));
          }
        });
        if (found.length !== 1) throw new Error(`${found.length} objects of splats`);
        return found[0];
      },
      ply: read(ply.GaussianSplatPLYLoader),
      spz: read(spz.SPZLoader),
      splat: read(splat.SPLATLoader),
      ksplat: read(ksplat.KSPLATLoader) } };
}
