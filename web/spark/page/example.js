// SPDX-License-Identifier: Apache-2.0
// A stream (?src=scene.l4d) and a mesh in one scene: each hides what lies behind it.
import {SparkRenderer, SplatMesh} from '@sparkjsdev/spark';
import {followRules, L4DSplats, open, sparkOptions} from 'l4dcodec-spark';
import * as THREE from 'three';
import {OrbitControls} from 'three/addons/controls/OrbitControls.js';

const find = (/** @type {string} */ name) => /** @type {any} */ (document.querySelector(name));
const [canvas, button, slider, output] = ['canvas', 'button', 'input', 'output'].map(find);

const renderer = new THREE.WebGLRenderer({canvas, antialias: false});
const scene = new THREE.Scene();
const camera = new THREE.PerspectiveCamera(50, 1, 0.02, 1000);
camera.position.set(0, 1, 9);
const spark = new SparkRenderer({renderer, ...sparkOptions});
followRules(spark);
scene.add(spark);

const mesh = new THREE.Mesh(new THREE.SphereGeometry(1, 48, 24), new THREE.MeshBasicMaterial({color: 0x00ff00}));
scene.add(mesh);

const movie = await open(new URLSearchParams(location.search).get('src') ?? 'scene.l4d');
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
slider.min = movie.timeBegin;
slider.max = movie.timeEnd;
slider.oninput = () => { movie.currentTime = Number(slider.value); };
button.onclick = () => { if (movie.paused) movie.play(); else movie.pause(); };
movie.loop = true;
movie.on('play', () => { button.textContent = 'Pause'; });
movie.on('pause', () => { button.textContent = 'Play'; });

const draw = () => renderer.render(scene, camera);
renderer.setAnimationLoop(() => {
  slider.value = String(movie.currentTime);
  output.value = `${movie.currentTime.toFixed(2)} s`;
  draw();
});
await movie.seek(movie.timeBegin);

/** For programs that drive the page, as its test does. */
Object.assign(globalThis, {example: {
  THREE, renderer, scene, camera, spark, mesh, movie, splats, controls, draw, SparkRenderer, SplatMesh, followRules, L4DSplats
}});
