// SPDX-License-Identifier: Apache-2.0
// A stream (?src=scene.l4d) and a mesh in one scene: each hides what lies behind it.
import {ArcRotateCamera} from '@babylonjs/core/Cameras/arcRotateCamera.js';
import {Engine} from '@babylonjs/core/Engines/engine.js';
import {StandardMaterial} from '@babylonjs/core/Materials/standardMaterial.js';
import {Color3, Color4} from '@babylonjs/core/Maths/math.color.js';
import {Matrix, Vector3} from '@babylonjs/core/Maths/math.vector.js';
import {CreateSphere} from '@babylonjs/core/Meshes/Builders/sphereBuilder.js';
import {Scene} from '@babylonjs/core/scene.js';
import {L4DSplats} from 'l4dcodec-babylon';
import {canvas, connect, source} from '../../spark/page/transport.js';

const engine = new Engine(canvas, true);
const scene = new Scene(engine);
scene.clearColor = new Color4(0, 0, 0, 1);
const camera = new ArcRotateCamera('camera', -Math.PI / 2, 1.4, 9, Vector3.Zero(), scene);
camera.minZ = 0.02;
camera.attachControl(canvas);

const mesh = CreateSphere('mesh', {diameter: 2}, scene);
mesh.material = Object.assign(new StandardMaterial('green', scene), {emissiveColor: new Color3(0, 1, 0), disableLighting: true});

const splats = new L4DSplats(scene, source);
splats.scaling.y = -1;  // y is down in the stream
const movie = await splats.load();

addEventListener('resize', () => engine.resize());
const show = connect(movie);
engine.runRenderLoop(() => {
  show();
  scene.render();
});

/** For programs that drive the page, as its test does. */
Object.assign(globalThis, {example: {engine, scene, camera, mesh, movie, splats, Matrix}});
