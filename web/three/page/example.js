// SPDX-License-Identifier: Apache-2.0
// A stream (?src=scene.l4d) and a mesh in one scene: each hides what lies behind it.
import {L4DSplats} from 'l4dcodec-three';
import * as THREE from 'three';
import {OrbitControls} from 'three/addons/controls/OrbitControls.js';
import {VRButton} from 'three/addons/webxr/VRButton.js';
import {canvas, connect, source} from '../../spark/page/transport.js';

const renderer = new THREE.WebGLRenderer({canvas, antialias: true});
const scene = new THREE.Scene();
const camera = new THREE.PerspectiveCamera(50, 1, 0.02, 1000);
camera.position.set(0, 1, 9);

const mesh = new THREE.Mesh(new THREE.SphereGeometry(1, 48, 24), new THREE.MeshBasicMaterial({color: 0x00ff00}));
scene.add(mesh);

const splats = new L4DSplats(source);
splats.rotation.x = Math.PI;  // y is down in the stream
scene.add(splats);
const movie = await splats.load();

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

renderer.xr.enabled = true;
const {xr} = /** @type {any} */ (navigator);
if (await xr?.isSessionSupported('immersive-vr')) document.body.append(VRButton.createButton(renderer));

/** For programs that drive the page, as its test does. */
Object.assign(globalThis, {example: {THREE, renderer, scene, camera, mesh, movie, splats, controls, draw, L4DSplats}});
