// SPDX-License-Identifier: Apache-2.0

const find = (/** @type {string} */ name) => /** @type {any} */ (document.querySelector(name));
const [canvas, button, slider, output] = ['canvas', 'button', 'input', 'output'].map(find);

export {canvas};
/** What the page is to show. */
export const source = new URLSearchParams(location.search).get('src') ?? 'scene.l4d';

/** The button and the slider of the page move a movie. @param {import('l4dcodec').Movie} movie @returns {() => void} called for each picture */
export const connect = movie => {
  slider.min = movie.timeBegin;
  slider.max = movie.timeEnd;
  slider.oninput = () => { movie.currentTime = Number(slider.value); };
  button.onclick = () => { if (movie.paused) movie.play(); else movie.pause(); };
  movie.loop = true;
  movie.on('play', () => { button.textContent = 'Pause'; });
  movie.on('pause', () => { button.textContent = 'Play'; });
  return () => {
    slider.value = String(movie.currentTime);
    output.value = `${movie.currentTime.toFixed(2)} s`;
  };
};
