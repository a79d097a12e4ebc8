// SPDX-License-Identifier: Apache-2.0
import {testEngine} from '../../test/engine-page.js';

testEngine('playcanvas', 'PlayCanvas', () => {
  const {app, camera, mesh, splats, Mat4, Quat} = /** @type {any} */ (globalThis).example;
  app.autoRender = false;
  const tools = {
    gl: app.graphicsDevice.gl,
    look({K, w2c}, width, height) {
      app.setCanvasFillMode('NONE', width, height);
      app.setCanvasResolution('FIXED', width, height);
      // The world of the scene has y up.
      const view = new Mat4().set([0, 1, 2, 3].flatMap(c => [0, 1, 2, 3].map(r => w2c[r][c] * (r % 3 === 0 ? 1 : -1) * (c % 3 === 0 ? 1 : -1))));
      const world = view.invert();
      camera.setPosition(world.getTranslation());
      camera.setRotation(new Quat().setFromMat4(world));
      const {nearClip, farClip} = camera.camera;
      camera.camera.calculateProjection = matrix => matrix.set(tools.projection(K, width, height, nearClip, farClip));
    },
    show(hasSplats, hasMesh) {
      splats.enabled = hasSplats;
      mesh.enabled = hasMesh;
    },
    place(z, scale) {
      mesh.setPosition(0, 0.5, -z);
      mesh.setLocalScale(2 * scale, 2 * scale, 2 * scale);
    },
    draw: () => app.render()
  };
  Object.assign(globalThis, {tools});
});
