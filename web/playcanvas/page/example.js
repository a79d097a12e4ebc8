// SPDX-License-Identifier: Apache-2.0
// A stream (?src=scene.l4d) and a mesh in one scene: each hides what lies behind it.
import {L4DSplats} from 'l4dcodec-playcanvas';
import {Application, Color, Entity, FILLMODE_FILL_WINDOW, Mat4, Quat, RESOLUTION_AUTO, StandardMaterial} from 'playcanvas';
import {canvas, connect, source} from '../../spark/page/transport.js';

const app = new Application(canvas, {graphicsDeviceOptions: {alpha: false}});
app.setCanvasFillMode(FILLMODE_FILL_WINDOW);
app.setCanvasResolution(RESOLUTION_AUTO);
addEventListener('resize', () => app.resizeCanvas());

const camera = new Entity('camera');
camera.addComponent('camera', {clearColor: new Color(0, 0, 0), nearClip: 0.02, farClip: 1000, fov: 50});
camera.setPosition(0, 1, 9);
app.root.addChild(camera);

const material = Object.assign(new StandardMaterial(), {diffuse: new Color(0, 0, 0), emissive: new Color(0, 1, 0), useLighting: false});
material.update();
const mesh = new Entity('mesh');
mesh.addComponent('render', {type: 'sphere', material});
mesh.setLocalScale(2, 2, 2);
app.root.addChild(mesh);

const splats = new L4DSplats(app, source);
splats.setLocalEulerAngles(180, 0, 0);  // y is down in the stream
app.root.addChild(splats);
const movie = await splats.load();

app.on('update', connect(movie));
app.start();

/** For programs that drive the page, as its test does. */
Object.assign(globalThis, {example: {app, camera, mesh, movie, splats, Mat4, Quat}});
