// SPDX-License-Identifier: Apache-2.0
import {Splats} from 'l4dcodec-player/splats';
import {
  BLENDEQUATION_ADD, BLENDMODE_ONE, BLENDMODE_ONE_MINUS_SRC_ALPHA, BlendState, DepthState, Entity, FUNC_LESSEQUAL, GAMMA_NONE, LAYERID_WORLD, Mat4, Vec3
} from 'playcanvas';

const blending = new BlendState(true, BLENDEQUATION_ADD, BLENDMODE_ONE, BLENDMODE_ONE_MINUS_SRC_ALPHA);
const depth = new DepthState(FUNC_LESSEQUAL, false);

/**
 * A stream in a scene: an entity, which is drawn after the opaque objects of its layer, hides what lies behind it and is hidden by
 * meshes before it. It shows the current time of its movie. The world of a stream has y down as a rule:
 * `splats.setLocalEulerAngles(180, 0, 0)` turns it.
 */
export class L4DSplats extends Entity {
  /**
   * @param {any} app @param {import('l4dcodec-player/splats').Source} source a URL, a File, bytes, or a movie
   * @param {import('l4dcodec-player/splats').SplatOptions} [options] those of `open`
   */
  constructor(app, source, options) {
    super('l4d', app);
    this.app = app;
    /** Of the opaque objects after which it is drawn. */
    this.layer = LAYERID_WORLD;
    this.splats = new Splats(source, options);
    app.scene.on('postrender:layer', this.#draw, this);
  }

  /** Opens the stream. Resolves to its movie when the first instant can be shown. */
  load() { return this.splats.load(); }
  /** Null until load() has opened it. */
  get movie() { return this.splats.movie; }

  /** Takes it out of its scene, frees what it has of the GPU, ends its workers, and its movie, unless that was given. */
  destroy() {
    this.app.scene.off('postrender:layer', this.#draw, this);
    this.splats.dispose();
    super.destroy();
  }

  /** @param {any} camera @param {any} layer @param {boolean} isTransparent */
  #draw(camera, layer, isTransparent) {
    if (isTransparent || layer.id !== this.layer || !this.enabled || !this.isDescendantOf(this.app.root)) return;
    // As PlayCanvas sees meshes, without the scale of the camera.
    const view = new Mat4().setTRS(camera.entity.getPosition(), camera.entity.getRotation(), Vec3.ONE).invert();
    const device = this.app.graphicsDevice;
    device.setBlendState(blending);
    device.setDepthState(depth);
    this.splats.draw(device.gl, {
      isSet: true, modelView: view.mul(this.getWorldTransform()).data, projection: camera.projectionMatrix.data,
      near: camera.nearClip, isLinear: camera.gammaCorrection === GAMMA_NONE
    });
  }
}
