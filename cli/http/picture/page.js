// SPDX-License-Identifier: Apache-2.0
// One picture is under way at a time. While something moves it is half as large.
const at = document.currentScript.src.replace(/[^/]*$/, '');
const canvas = document.querySelector('canvas'), context = canvas.getContext('2d');
const button = document.querySelector('button'), slider = document.querySelector('input');
const output = document.querySelector('output');
const view = {time: 0, angle: 0, rise: 0, zoom: 1};
let scene = null, playing = false, busy = false, shown = '', moved = 0, before = 0;

function size(share) {
  const side = (n) => Math.min(4096, Math.max(16, Math.round(n * share * devicePixelRatio)));
  return `${side(canvas.clientWidth)}x${side(canvas.clientHeight)}`;
}
function touch() {
  moved = performance.now();
}
async function draw(share) {
  const wanted = [size(share), view.time.toFixed(6), view.angle.toFixed(5), view.rise.toFixed(5),
    view.zoom.toFixed(5)].join('/');
  if (wanted === shown) return;
  busy = true;
  try {
    const answer = await fetch(at + wanted);
    if (!answer.ok) throw new Error(await answer.text());
    const picture = await createImageBitmap(await answer.blob());
    canvas.width = picture.width;
    canvas.height = picture.height;
    context.drawImage(picture, 0, 0);
    shown = wanted;
  } catch (error) {
    playing = false;
    output.textContent = `No picture: ${error.message}`;
    shown = wanted;
  }
  busy = false;
}
function frame(now) {
  if (playing) {
    view.time += (now - before) / 1000;
    if (view.time >= scene.end) view.time = scene.begin + (view.time - scene.end) % (scene.end - scene.begin);
    slider.value = view.time;
    output.textContent = `${view.time.toFixed(2)} s`;
    touch();
  }
  before = now;
  button.textContent = playing ? 'Pause' : 'Play';
  if (!busy) draw(now - moved < 250 ? 0.5 : 1);
  requestAnimationFrame(frame);
}
function turn(right, up) {
  view.angle -= right;
  view.rise = Math.min(3, Math.max(-3, view.rise + up));
  touch();
}
function nearer(factor) {
  view.zoom = Math.min(100, Math.max(0.01, view.zoom * factor));
  touch();
}
button.onclick = () => { playing = !playing; };
slider.oninput = () => {
  view.time = Number(slider.value);
  output.textContent = `${view.time.toFixed(2)} s`;
  touch();
};
const fingers = new Map();
canvas.onpointerdown = (event) => {
  canvas.setPointerCapture(event.pointerId);
  fingers.set(event.pointerId, event);
};
canvas.onpointermove = (event) => {
  const last = fingers.get(event.pointerId);
  if (last === undefined) return;
  const apart = () => {
    const [a, b] = fingers.values();
    return Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
  };
  const wide = fingers.size === 2 ? apart() : 0;
  fingers.set(event.pointerId, event);
  if (fingers.size === 2) nearer(apart() / Math.max(wide, 1));
  else turn((event.clientX - last.clientX) * 0.006, (event.clientY - last.clientY) * 0.006);
};
canvas.onpointerup = canvas.onpointercancel = (event) => fingers.delete(event.pointerId);
canvas.addEventListener('wheel', (event) => {
  event.preventDefault();
  nearer(Math.exp(-0.001 * event.deltaY));
}, {passive: false});
canvas.onkeydown = (event) => {
  const act = {
    ArrowLeft: () => turn(-0.1, 0), ArrowRight: () => turn(0.1, 0), ArrowUp: () => turn(0, 0.1),
    ArrowDown: () => turn(0, -0.1), '+': () => nearer(1.1), '-': () => nearer(1 / 1.1), ' ': () => button.click(),
  }[event.key];
  if (act === undefined) return;
  event.preventDefault();
  act();
};
fetch(`${at}scene.json`).then((answer) => answer.json()).then((found) => {
  scene = found;
  document.title = scene.name;
  view.time = scene.begin;
  slider.min = scene.begin;
  slider.max = scene.end;
  slider.value = view.time;
  playing = scene.end > scene.begin;
  slider.disabled = button.disabled = !playing;
  requestAnimationFrame(frame);
});
