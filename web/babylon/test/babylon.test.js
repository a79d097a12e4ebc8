// SPDX-License-Identifier: Apache-2.0
import {testEngine} from '../../test/engine-page.js';

testEngine('babylon', 'Babylon.js', () => {
  const {engine, scene, camera, mesh, splats, Matrix} = /** @type {any} */ (globalThis).example;
  engine.stopRenderLoop();
  camera.detachControl();
  const tools = {
    gl: engine._gl,
    look({K, w2c}, width, height) {
      engine.setSize(width, height);
      // The world of the scene has y up and a left hand.
      const view = Matrix.FromArray([0, 1, 2, 3].flatMap(c => [0, 1, 2, 3].map(r => w2c[r][c] * (r === 1 ? -1 : 1) * (c === 1 ? -1 : 1))));
      const projection = tools.projection(K, width, height, camera.minZ, camera.maxZ);
      // Of a camera that looks along z.
      for (let k = 8; k < 12; ++k) projection[k] *= -1;
      camera.getViewMatrix = () => view;
      camera.getProjectionMatrix = () => Matrix.FromArray(projection);
    },
    show(hasSplats, hasMesh) {
      splats.setEnabled(hasSplats);
      mesh.setEnabled(hasMesh);
    },
    place(z, scale) {
      mesh.position.set(0, 0.5, z);
      mesh.scaling.setAll(scale);
    },
    draw: () => scene.render()
  };
  Object.assign(globalThis, {tools});
});
