// SPDX-License-Identifier: Apache-2.0
import '@babylonjs/core/Engines/AbstractEngine/abstractEngine.alpha.js';
import '@babylonjs/core/Engines/AbstractEngine/abstractEngine.states.js';
import '@babylonjs/core/Engines/Extensions/engine.alpha.js';
import {Constants} from '@babylonjs/core/Engines/constants.js';
import {Mesh} from '@babylonjs/core/Meshes/mesh.js';
import {VertexData} from '@babylonjs/core/Meshes/mesh.vertexData.js';
import {Splats} from 'l4dcodec-player/splats';

/**
 * A stream in a scene: a transparent mesh, which is drawn after opaque ones, hides what lies behind it and is hidden by meshes
 * before it. It shows the current time of its movie. The world of a stream has y down as a rule, and a right hand: in a scene
 * with y up and a left hand, as scenes are at first, `splats.scaling.y = -1` turns it.
 */
export class L4DSplats extends Mesh {
  /**
   * @param {any} scene @param {import('l4dcodec-player/splats').Source} source a URL, a File, bytes, or a movie
   * @param {import('l4dcodec-player/splats').SplatOptions} [options] those of `open`
   */
  constructor(scene, source, options) {
    super('l4d', scene);
    // Babylon.js itself draws nothing of it, but puts what has a triangle and such colours into its transparent list.
    Object.assign(new VertexData(), {positions: new Float32Array(9), indices: [0, 1, 2]}).applyToMesh(this);
    this.hasVertexAlpha = true;
    this.alwaysSelectAsActiveMesh = true;
    this.isPickable = false;
    this.splats = new Splats(source, options);
  }

  /** Opens the stream. Resolves to its movie when the first instant can be shown. */
  load() { return this.splats.load(); }
  /** Null until load() has opened it. */
  get movie() { return this.splats.movie; }

  /** Takes it out of its scene, frees what it has of the GPU, ends its workers, and its movie, unless that was given. */
  dispose(/** @type {any[]} */ ...how) {
    this.splats.dispose();
    super.dispose(...how);
  }

  /** In the place of what Babylon.js would draw. */
  render() {
    const scene = this.getScene(), engine = /** @type {any} */ (scene.getEngine());
    engine.setAlphaMode(Constants.ALPHA_PREMULTIPLIED_PORTERDUFF);
    engine.setAlphaEquation(Constants.ALPHA_EQUATION_ADD);
    engine.setColorWrite(true);
    if (engine.useReverseDepthBuffer) engine.setDepthFunctionToGreaterOrEqual();
    else engine.setDepthFunctionToLessOrEqual();
    engine.applyStates();
    this.splats.draw(engine._gl, {
      isSet: true,
      modelView: this.getWorldMatrix().multiply(scene.getViewMatrix()).m, projection: scene.getProjectionMatrix().m,
      near: scene.activeCamera?.minZ ?? 0, isReversed: engine.useReverseDepthBuffer,
      isLinear: scene.imageProcessingConfiguration.applyByPostProcess
    });
    return this;
  }
}
