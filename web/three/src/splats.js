// SPDX-License-Identifier: Apache-2.0
import {Splats} from 'l4dcodec-player/splats';
import * as THREE from 'three';

/**
 * A stream in a scene: a transparent object, which is drawn after opaque ones, hides what lies behind it and is hidden by
 * meshes before it. It shows the current time of its movie. The world of a stream has y down as a rule:
 * `splats.rotation.x = Math.PI` turns it.
 */
export class L4DSplats extends THREE.Mesh {
  /**
   * @param {import('l4dcodec-player/splats').Source} source a URL, a File, bytes, or a movie
   * @param {import('l4dcodec-player/splats').SplatOptions} [options] those of `open`
   */
  constructor(source, options) {
    // three.js itself draws nothing of it.
    const geometry = new THREE.BufferGeometry();
    geometry.setDrawRange(0, -1);
    super(geometry, new THREE.MeshBasicMaterial({
      transparent: true, depthWrite: false, blending: THREE.CustomBlending, blendSrc: THREE.OneFactor, blendDst: THREE.OneMinusSrcAlphaFactor
    }));
    this.frustumCulled = false;
    this.splats = new Splats(source, options);
    /** Where pictures of several cameras take their order from; null: from the camera that draws. @type {any} */
    this.sortCamera = null;
    /** @type {{frame: number, views: any[]}} */
    this.sorted = {frame: -1, views: []};
  }

  /** Opens the stream. Resolves to its movie when the first instant can be shown. */
  load() { return this.splats.load(); }
  /** Null until load() has opened it. */
  get movie() { return this.splats.movie; }

  /** Called when another picture would show something new, for pages that draw on request. @param {() => void} fn */
  set onchange(fn) { this.splats.onchange = fn; }

  /** Takes it out of its scene, frees what it has of the GPU, ends its workers, and its movie, unless that was given. */
  dispose() {
    this.removeFromParent();
    this.splats.dispose();
    this.geometry.dispose();
    this.material.dispose();
  }

  raycast() {}

  /**
   * three.js has set what the material says, and drawn nothing.
   * @param {any} renderer @param {any} _scene @param {any} camera @param {any} _geometry @param {any} material
   */
  onAfterRender(renderer, _scene, camera, _geometry, material) {
    if (material !== this.material) return;  // of a pass that draws no colours
    const {frame} = renderer.info.render;
    // The cameras of an array draw one after the other in one frame.
    if (this.sorted.frame !== frame) {
      const {xr} = renderer;
      const cameras = this.sortCamera ? [this.sortCamera] : xr.isPresenting ? xr.getCamera().cameras : [camera];
      this.sorted = {frame, views: cameras.map((/** @type {any} */ c) => this.#view(c))};
    }
    const target = renderer.getRenderTarget();
    // three.js turns colours into those of screens when it draws for these.
    const isLinear = target && !target.isXRRenderTarget && THREE.ColorManagement.workingColorSpace === THREE.LinearSRGBColorSpace;
    const view = {...this.#view(camera), isSet: true, isLinear, isReversed: camera.reversedDepth === true};
    this.splats.draw(renderer.getContext(), view, this.sorted.views);
  }

  /** @param {any} camera */
  #view(camera) {
    const modelView = new THREE.Matrix4().multiplyMatrices(camera.matrixWorldInverse, this.matrixWorld);
    return {modelView: modelView.elements, projection: camera.projectionMatrix.elements, near: camera.near};
  }
}
