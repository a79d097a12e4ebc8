// SPDX-License-Identifier: Apache-2.0

const turnStep = 0.08;
const zoomStep = 0.9;

/**
 * What a key does, as in video players; false where it does nothing.
 * @param {KeyboardEvent} event @param {import('./element.js').L4DPlayer} player @returns {boolean}
 */
export const onKey = (event, player) => {
  if (event.ctrlKey || event.metaKey || !player.movie) return false;
  const movie = player.movie;
  const by = (/** @type {number} */ seconds) => player.seek(movie.currentTime + seconds);
  const frame = 1 / movie.info.frameRate;
  const steer = (/** @type {(camera: import('./camera.js').OrbitCamera) => void} */ fn) => {
    if (player.view) fn(player.view.orbit);
    player.steered();
  };
  const turn = (/** @type {number} */ x, /** @type {number} */ y) => steer(() => player.pointer?.turn(x, y));
  const move = (/** @type {number} */ right, /** @type {number} */ down, /** @type {number} */ forward) =>
    steer(camera => camera.move(right, down, forward));
  if (event.altKey) {
    if (event.key === 'ArrowLeft') turn(-turnStep, 0);
    else if (event.key === 'ArrowRight') turn(turnStep, 0);
    else if (event.key === 'ArrowUp') turn(0, turnStep);
    else if (event.key === 'ArrowDown') turn(0, -turnStep);
    else if (event.key === '+' || event.key === '=') steer(camera => camera.widen(zoomStep));
    else if (event.key === '-') steer(camera => camera.widen(1 / zoomStep));
    else return false;
    return true;
  }
  /** @type {Record<string, () => unknown>} */
  const keys = {
    ' ': () => player.toggle(), k: () => player.toggle(),
    j: () => by(-Math.min(10, movie.duration / 5)), l: () => by(Math.min(10, movie.duration / 5)),
    ArrowLeft: () => by(-Math.min(5, movie.duration / 10)), ArrowRight: () => by(Math.min(5, movie.duration / 10)),
    ',': () => { movie.pause(); by(-frame); }, '.': () => { movie.pause(); by(frame); },
    Home: () => player.seek(movie.timeBegin), End: () => player.seek(movie.live ? movie.startTime : movie.timeEnd),
    '<': () => player.setRate(movie.rate / 2), '>': () => player.setRate(movie.rate * 2),
    c: () => player.captions.toggle(), f: () => player.toggleFullscreen(), i: () => player.toggleOverlay(), 0: () => player.home(),
    '+': () => steer(camera => camera.zoom(zoomStep)), '=': () => steer(camera => camera.zoom(zoomStep)),
    '-': () => steer(camera => camera.zoom(1 / zoomStep)),
    w: () => move(0, 0, 0.04), s: () => move(0, 0, -0.04), a: () => move(-0.04, 0, 0), d: () => move(0.04, 0, 0),
    Escape: () => player.toggleMenu(false)
  };
  const action = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (!action) return false;
  action();
  return true;
};
