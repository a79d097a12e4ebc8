// SPDX-License-Identifier: Apache-2.0
import {dyno, SplatGenerator} from '@sparkjsdev/spark';
import * as THREE from 'three';
import {sliceFunctions} from './shader.js';
import {RowTextures, rowsPerLine} from './textures.js';

/** For `new SparkRenderer({renderer, ...sparkOptions})`: this package hands covariances over, in more than 8 bits. */
export const sparkOptions = Object.freeze({covSplats: true, accumExtSplats: true});

/**
 * A stream in a scene: an Object3D, which Spark draws together with all other splats of the scene, and behind and in
 * front of meshes. It shows the current time of its movie at each call of `renderer.render`. The world of a stream has
 * y down as a rule: `splats.rotation.x = Math.PI` turns it.
 */
export class L4DSplats extends SplatGenerator {
  /** @param {import('l4dcodec').Movie} movie stays the caller's, who disposes of it */
  constructor(movie) {
    const degree = movie.info.shDegree;
    const textures = texturesOf(movie);
    const uniforms = {
      rows: new dyno.DynoSampler2D({value: textures.rows}), harmonics: new dyno.DynoSampler2D({value: textures.harmonics}),
      times: new dyno.DynoSampler2D({value: textures.times}), basis: new dyno.DynoMat3({value: new THREE.Matrix3()}),
      offset: new dyno.DynoVec3({value: new THREE.Vector3()}), eye: new dyno.DynoVec3({value: new THREE.Vector3()})
    };
    super({numSplats: textures.lines * rowsPerLine, covGenerator: covGenerator(degree, textures.shTexels, uniforms)});
    this.movie = movie;
    this.textures = textures;
    this.uniforms = uniforms;
    /** The time of the last picture, in seconds. */
    this.shownTime = NaN;
    this.frameUpdate = (/** @type {any} */ context) => this.#prepare(context);
    // What decides on the picture, beside time and rows.
    this.drawnFrom = new Float64Array(15);
    this.rowsChanged = true;
    this.refused = new Set();
    /** Textures that are being filled, to take the place of these. @type {RowTextures | null} */
    this.next = null;
    this.isFilling = false;  // what comes is for them
    this.ends = [
      movie.on('rows', (/** @type {any} */ rows) => this.#add(rows)),
      movie.on('info', () => this.#widen()),
      movie.on('refreshed', () => { this.isFilling = this.next !== null; }),
      movie.on('ready', () => this.#swap()),
      movie.on('removed', (/** @type {string} */ key) => { this.next?.remove(key); this.textures.remove(key); this.refused.delete(key); this.rowsChanged = true; })
    ];
    movie.refresh();
  }

  /** Buckets that did not fit (`maxRows` of `open`). */
  get missing() { return this.refused.size; }

  /** Takes it out of its scene and frees its textures. */
  dispose() {
    for (const end of this.ends) end();
    this.next?.dispose();
    this.removeFromParent();
    this.textures.dispose();
  }

  /** @param {import('l4dcodec').BucketRows} rows */
  #add(rows) {
    if ((this.next ?? this.textures).add(rows)) this.refused.delete(rows.key);
    else this.refused.add(rows.key);
    this.#useTextures();
  }

  /** They are others after they have grown. */
  #useTextures() {
    const {textures, uniforms} = this;
    uniforms.rows.value = textures.rows;
    uniforms.harmonics.value = textures.harmonics;
    uniforms.times.value = textures.times;
    this.numSplats = textures.lines * rowsPerLine;
    this.rowsChanged = true;
  }

  /** Another stream of the movie may have more rows, or colours of a higher degree. */
  #widen() {
    const {movie} = this;
    const wanted = texturesOf(movie);
    if (wanted.shTexels === this.textures.shTexels) {
      this.textures.maxLines = wanted.maxLines;
      return wanted.dispose();
    }
    this.next?.dispose();
    this.next = wanted;
    this.isFilling = false;
    movie.refresh();
  }

  /** Shows the next textures, once what is shown is in them. */
  #swap() {
    const {next, movie} = this;
    const isThere = movie.ready.detail === 'full' || movie.detail === 'base' || !movie.paused;
    if (!next || !this.isFilling || !isThere) return;
    this.isFilling = false;
    this.textures.dispose();
    this.textures = next;
    this.next = null;
    this.covGenerator = covGenerator(movie.info.shDegree, next.shTexels, this.uniforms);
    this.#useTextures();
  }

  /** Called by Spark before each picture. @param {{viewToWorld: any}} context */
  #prepare({viewToWorld}) {
    const {uniforms, movie} = this;
    this.updateWorldMatrix(true, false);
    uniforms.basis.value.setFromMatrix4(this.matrixWorld);
    uniforms.offset.value.setFromMatrixPosition(this.matrixWorld);
    uniforms.eye.value.setFromMatrixPosition(viewToWorld).applyMatrix4(this.matrixWorld.clone().invert());
    const from = [...uniforms.basis.value.elements, ...uniforms.offset.value.toArray(), ...uniforms.eye.value.toArray()];
    const time = movie.currentTime;
    if (!this.rowsChanged && time === this.shownTime && from.every((v, k) => v === this.drawnFrom[k])) return;
    this.drawnFrom.set(from);
    this.rowsChanged = false;
    this.shownTime = time;
    this.textures.setTime(movie.streamsAt(time));
    this.updateVersion();
  }
}

/** @param {import('l4dcodec').Movie} movie */
const texturesOf = ({info, maxRows}) => new RowTextures(maxRows, Math.ceil(3 * (info.shDegree + 1) ** 2 / 4));

/** The block of Spark's shader graph that slices. @param {number} degree @param {number} texels @param {Record<string, any>} uniforms */
const covGenerator = (degree, texels, uniforms) => new dyno.Dyno({
  inTypes: {index: 'int', rows: 'sampler2D', harmonics: 'sampler2D', times: 'sampler2D', basis: 'mat3', offset: 'vec3', eye: 'vec3'},
  outTypes: {covsplat: dyno.CovSplat},
  inputs: uniforms,
  globals: () => [dyno.defineGsplat, dyno.defineCovSplat, sliceFunctions(degree, texels)],
  statements: (/** @type {any} */ {inputs: n, outputs}) => [
    `${outputs.covsplat} = l4dSlice(${n.index}, ${n.rows}, ${n.harmonics}, ${n.times}, ${n.basis}, ${n.offset}, ${n.eye});`
  ]
});
