// SPDX-License-Identifier: Apache-2.0
// A stream (?src=scene.l4d) and a mesh in one scene: each hides what lies behind it.
import {SparkRenderer, SplatMesh} from '@sparkjsdev/spark';
import {followRules, L4DSplats, open, sparkOptions} from 'l4dcodec-spark';
import * as THREE from 'three';
import {OrbitControls} from 'three/addons/controls/OrbitControls.js';
import {canvas, connect, source} from './transport.js';

const renderer = new THREE.WebGLRenderer({canvas, antialias: false});
const scene = new THREE.Scene();
const camera = new THREE.PerspectiveCamera(50, 1, 0.02, 1000);
camera.position.set(0, 1, 9);
const spark = new SparkRenderer({renderer, ...sparkOptions});
followRules(spark);
scene.add(spark);

const mesh = new THREE.Mesh(new THREE.SphereGeometry(1, 48, 24), new THREE.MeshBasicMaterial({color: 0x00ff00}));
scene.add(mesh);

const movie = await open(source);
const splats = new L4DSplats(movie);
splats.rotation.x = Math.PI;  // y is down in the stream
scene.add(splats);

const resize = () => {
  const {clientWidth, clientHeight} = canvas;
  renderer.setPixelRatio(devicePixelRatio);
  renderer.setSize(clientWidth, clientHeight, false);
  camera.aspect = clientWidth / clientHeight;
  camera.updateProjectionMatrix();
};
addEventListener('resize', resize);
resize();

const controls = new OrbitControls(camera, canvas);
controls.update();
const show = connect(movie);

const draw = () => renderer.render(scene, camera);
renderer.setAnimationLoop(() => {
  show();
  draw();
});
await movie.seek(movie.timeBegin);

/** For programs that drive the page, as its test does. */
Object.assign(globalThis, {example: {
  THREE, renderer, scene, camera, spark, mesh, movie, splats, controls, draw, SparkRenderer, SplatMesh, followRules, L4DSplats
}});
