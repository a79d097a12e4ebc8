// SPDX-License-Identifier: Apache-2.0
import {trustedHtml} from 'l4dcodec';

const icon = (/** @type {string} */ path) =>
  `<svg viewBox="0 0 24 24" aria-hidden="true" focusable="false"><path d="${path}"/></svg>`;

const icons = {
  play: icon('M8 5.14v13.72a.6.6 0 0 0 .92.5l10.7-6.86a.6.6 0 0 0 0-1L8.92 4.64A.6.6 0 0 0 8 5.14Z'),
  pause: icon('M7 5h3.5v14H7zM13.5 5H17v14h-3.5z'),
  again: icon('M12 5V1.5L7 6l5 4.5V7a5 5 0 1 1-5 5H5a7 7 0 1 0 7-7Z'),
  home: icon('M12 8.5a3.5 3.5 0 1 0 0 7 3.5 3.5 0 0 0 0-7ZM4 10V4h6v2H6v4H4Zm10-6h6v6h-2V6h-4V4ZM4 14h2v4h4v2H4v-6Zm14 4v-4h2v6h-6v-2h4Z'),
  menu: icon('M10.3 3.5h3.4l.5 2.4 1.6.9 2.3-.8 1.7 3-1.8 1.6v1.8l1.8 1.6-1.7 3-2.3-.8-1.6.9-.5 2.4h-3.4l-.5-2.4-1.6-.9-2.3.8-1.7-3L6 12.4v-1.8L4.2 9l1.7-3 2.3.8 1.6-.9.5-2.4ZM12 9a2.8 2.8 0 1 0 0 5.6A2.8 2.8 0 0 0 12 9Z'),
  captions: icon('M4 5h16a1.5 1.5 0 0 1 1.5 1.5v11A1.5 1.5 0 0 1 20 19H4a1.5 1.5 0 0 1-1.5-1.5v-11A1.5 1.5 0 0 1 4 5Zm1.5 5.5v2h5v-2h-5Zm7 0v2h6v-2h-6Zm-7 4v2h7v-2h-7Zm9 0v2h4v-2h-4Z'),
  full: icon('M4 4h6v2H6v4H4V4Zm10 0h6v6h-2V6h-4V4ZM4 14h2v4h4v2H4v-6Zm14 0h2v6h-6v-2h4v-4Z')
};

const style = `
:host { display: block; position: relative; aspect-ratio: 16 / 9; min-width: 240px; overflow: hidden;
  background: #0b0d10; color: #f2f4f7; font: 13px/1.4 system-ui, "Segoe UI", Roboto, "Helvetica Neue", sans-serif;
  --accent: #5ab0ff; container-type: size; border-radius: var(--l4d-radius, 10px); }
:host([hidden]) { display: none; }
:host(:fullscreen) { border-radius: 0; aspect-ratio: auto; }
* { box-sizing: border-box; }
canvas { position: absolute; inset: 0; width: 100%; height: 100%; display: block; touch-action: none; cursor: grab; outline: none; }
:host([scrolls]) canvas { touch-action: pan-y; }
:host([gestures=none]) canvas { touch-action: auto; cursor: auto; }
.still { pointer-events: none; }
slot[name=fallback] { display: none; }
:host([unsupported]) slot[name=fallback] { display: block; }
::slotted([slot=fallback]) { position: absolute; inset: 0; width: 100%; height: 100%; object-fit: cover; }
:host([controls=none]) :is(.bar, .shade, .big, .menu), :host([unsupported]) :is(.bar, .shade, .big, .menu) { display: none; }
.spots { position: absolute; inset: 0; overflow: clip; isolation: isolate; pointer-events: none; }
.spots slot { position: absolute; left: 0; top: 0; display: block; width: max-content; }
.spots ::slotted(*) { pointer-events: auto; }
.hint { position: absolute; inset: 0; margin: auto; width: fit-content; height: fit-content; padding: 9px 14px; border-radius: 8px;
  background: rgb(9 12 16 / .8); pointer-events: none; opacity: 0; transition: opacity .2s; }
.hint.on { opacity: 1; }
canvas:active { cursor: grabbing; }
canvas:focus-visible { box-shadow: inset 0 0 0 2px var(--accent); }
.poster { position: absolute; inset: 0; width: 100%; height: 100%; object-fit: cover; transition: opacity .3s; pointer-events: none; }
.poster.gone { opacity: 0; }
.shade { position: absolute; inset: auto 0 0 0; height: 132px; pointer-events: none;
  background: linear-gradient(transparent, rgb(5 7 10 / .38) 45%, rgb(5 7 10 / .84)); }
.bar { position: absolute; inset: auto 0 0 0; padding: 0 14px 10px; }
.shade, .bar { transition: opacity .25s; }
:host([idle]) .shade, :host([idle]) .bar { opacity: 0; }
:host([idle]) .bar:focus-within { opacity: 1; }
:host([idle]) canvas { cursor: none; }
.row { display: flex; align-items: center; gap: 2px; }
.space { flex: 1; }
button { appearance: none; border: 0; margin: 0; padding: 8px; width: 40px; height: 40px; border-radius: 8px; background: none; color: inherit;
  font: inherit; cursor: pointer; display: grid; place-items: center; -webkit-tap-highlight-color: transparent; }
button svg { width: 22px; height: 22px; fill: currentColor; display: block; }
button:hover { background: rgb(255 255 255 / .14); }
button:focus-visible, input:focus-visible, select:focus-visible { outline: 2px solid var(--accent); outline-offset: 1px; }
.time { font-variant-numeric: tabular-nums; padding: 0 8px; white-space: nowrap; }
.time .of { color: #b9c1cc; }
.track { position: relative; height: 22px; margin: 0 6px; cursor: pointer; }
.track .rail, .track .spans, .track .done { position: absolute; left: 0; top: 9px; height: 4px; border-radius: 2px; pointer-events: none; transition: transform .12s; }
.track .rail { right: 0; background: rgb(255 255 255 / .22); }
.track .spans { right: 0; overflow: hidden; }
.track .spans i { position: absolute; top: 0; bottom: 0; background: rgb(255 255 255 / .34); }
.track .done { background: var(--accent); width: 0; }
.track:hover .rail, .track:hover .spans, .track:hover .done { transform: scaleY(1.5); }
.track input { position: absolute; inset: 0; width: 100%; height: 100%; margin: 0; background: none; appearance: none; cursor: pointer; border-radius: 6px; }
.track input::-webkit-slider-runnable-track { height: 22px; }
.track input::-webkit-slider-thumb { appearance: none; width: 14px; height: 14px; margin-top: 4px; border-radius: 50%; background: #fff; border: 0;
  box-shadow: 0 1px 4px rgb(0 0 0 / .5); }
.track input::-moz-range-thumb { width: 14px; height: 14px; border-radius: 50%; background: #fff; border: 0; }
.hover { position: absolute; bottom: 24px; transform: translateX(-50%); padding: 2px 7px; border-radius: 5px; background: rgb(12 15 20 / .92);
  font-variant-numeric: tabular-nums; pointer-events: none; visibility: hidden; text-align: center; }
.thumb { overflow: hidden; margin: 3px -3px 2px; border-radius: 3px; } .thumb img { display: block; transform-origin: 0 0; }
.track.scrubbed .hover { visibility: visible; }
@media (hover: hover) { .track:hover .hover { visibility: visible; } }
.big { position: absolute; inset: 0; margin: auto; width: 76px; height: 76px; border-radius: 50%; background: rgb(12 15 20 / .6);
  backdrop-filter: blur(6px); transition: transform .15s, background .15s; }
.big svg { width: 38px; height: 38px; }
.play svg { display: none; }
.play[data-label=play] svg:nth-child(1), .play[data-label=pause] svg:nth-child(2), .play[data-label=again] svg:nth-child(3) { display: block; }
.big:hover { transform: scale(1.06); background: rgb(30 38 48 / .72); }
.spinner { position: absolute; inset: 0; margin: auto; width: 44px; height: 44px; border-radius: 50%; border: 3px solid rgb(255 255 255 / .2);
  border-top-color: #fff; pointer-events: none; }
.overlay { position: absolute; top: 12px; left: 12px; padding: 9px 12px; border-radius: 8px; background: rgb(9 12 16 / .74); backdrop-filter: blur(6px);
  font: 12px/1.55 ui-monospace, "SF Mono", Menlo, Consolas, monospace; display: grid; grid-template-columns: auto auto; gap: 0 14px; pointer-events: none; margin: 0; }
.overlay dt { color: #aeb8c5; } .overlay dd { margin: 0; text-align: right; }
.menu { position: absolute; right: 14px; bottom: 58px; padding: 12px 14px; border-radius: 10px; background: rgb(16 20 26 / .96); display: grid; gap: 10px;
  grid-template-columns: auto auto; align-items: center; box-shadow: 0 10px 32px rgb(0 0 0 / .5); max-height: calc(100% - 76px); overflow: auto; }
.menu select { font: inherit; color: inherit; background: #2a323d; border: 1px solid #4b5666; border-radius: 6px; padding: 5px 8px; min-width: 108px; }
.menu label { color: #d5dbe3; }
.menu input[type=checkbox] { width: 18px; height: 18px; justify-self: end; accent-color: var(--accent); }
.actions { grid-column: 1 / -1; display: flex; flex-flow: column; gap: 6px; }
.actions button { flex: auto; width: auto; min-height: 30px; height: 34px; background: #2a323d; }
.message { position: absolute; inset: 0; display: grid; place-content: center; justify-items: center; text-align: center; padding: 24px; gap: 12px; }
.message.over { background: rgb(9 12 16 / .86); }
:host([unsupported]) .message { inset: auto 0 0 0; padding: 12px; gap: 4px; }
:host([unsupported]) .message button { display: none; }
.message b { font-size: 16px; font-weight: 600; } .message p { margin: 0; max-width: 54ch; color: #c3cbd6; overflow-wrap: anywhere; }
.message button { width: auto; padding: 8px 18px; background: #2a323d; }
.note { position: absolute; top: 12px; right: 12px; max-width: min(36ch, 60%); padding: 7px 11px; border-radius: 8px; background: rgb(9 12 16 / .74);
  color: #ffd9a0; font-size: 13px; pointer-events: none; }
.drop { position: absolute; inset: 10px; border: 2px dashed var(--accent); border-radius: 10px; pointer-events: none; background: rgb(90 176 255 / .12); display: none; }
:host([dragging]) .drop { display: block; }
.said { position: absolute; width: 1px; height: 1px; overflow: hidden; clip-path: inset(50%); white-space: nowrap; }
[hidden] { display: none !important; }
.captions, ::slotted([slot=captions]) { position: absolute; left: 8%; right: 8%; bottom: 78px; text-align: center; pointer-events: none; }
.captions { font-size: clamp(14px, 4.6cqmin, 28px); transition: bottom .25s; }
.captions p { margin: 3px auto 0; width: fit-content; padding: 1px 8px; border-radius: 4px; background: rgb(0 0 0 / .74); white-space: pre-line; }
:host([idle]) .captions, :host([controls=none]) .captions { bottom: 5%; }
.cc[aria-pressed=true] { background: linear-gradient(var(--accent) 0 0) 50% calc(100% - 4px) / 22px 2px no-repeat; }
@container (max-width: 460px) {
  .bar { padding: 0 6px 6px; } button { width: 44px; height: 44px; } .time .of { display: none; } .overlay { font-size: 11px; padding: 7px 9px; top: 8px; left: 8px; }
  .menu { right: 6px; bottom: 62px; } .big { width: 66px; height: 66px; }
}
@container (max-height: 200px) {
  .message { padding: 8px; gap: 6px; } .message b { font-size: 13px; } .message p { max-height: 4.2em; overflow: hidden; font-size: 11px; }
}
@container (max-height: 340px) or ((max-height: 450px) and (min-width: 380px)) {
  .menu { grid-template-columns: repeat(4, auto); padding: 8px 10px; gap: 6px 8px; max-height: calc(100% - 66px); }
  .menu select { min-width: 0; width: 100%; padding: 4px 2px; } .actions { flex-flow: wrap; } .actions button { height: 30px; padding: 0 8px; }
}
@media (pointer: coarse) { .bar button { width: 44px; height: 44px; } .track, .track input::-webkit-slider-runnable-track { height: 32px; }
  .captions { bottom: 92px; } .track .rail, .track .spans, .track .done { top: 14px; } .track input::-webkit-slider-thumb { margin-top: 9px; } }
@media (prefers-reduced-motion: reduce) { * { transition: none !important; } }
`;

/** @param {ShadowRoot} root */
export const fill = root => {
  root.innerHTML = trustedHtml(html);
  addStyle(root);
};

/**
 * Styles that a content security policy does not take for inline ones. @param {ShadowRoot} root
 */
const addStyle = root => {
  if ('adoptedStyleSheets' in root) {
    const sheet = new CSSStyleSheet();
    sheet.replaceSync(style);
    root.adoptedStyleSheets = [sheet];
  } else {
    const element = document.createElement('style');
    element.textContent = style;
    /** @type {ShadowRoot} */ (root).prepend(element);
  }
};

const html = `<canvas part="canvas" tabindex="0" role="application" data-label="scene"></canvas>
<img class="poster" part="poster" alt="" hidden>
<slot name="fallback"></slot>
<div class="spots"></div>
<slot name="captions"></slot>
<div class="spinner" role="presentation" hidden></div>
<button class="big" part="big" data-label="play" tabindex="-1" aria-hidden="true" hidden>${icons.play}</button>
<div class="captions" part="captions"></div>
<dl class="overlay" part="overlay" hidden></dl>
<div class="shade"></div>
<div class="bar" part="bar" role="group" data-label="controls">
  <div class="track" part="timeline">
    <div class="rail"></div><div class="spans"></div><div class="done"></div>
    <input type="range" min="0" max="1" step="any" value="0" data-label="time">
    <div class="hover" aria-hidden="true"><div class="thumb" hidden><img alt=""></div><span></span></div>
  </div>
  <div class="row">
    <button class="play" data-label="play" data-key="space">${icons.play}${icons.pause}${icons.again}</button>
    <span class="time"><span class="now">0:00.0</span> <span class="of">/ <span class="end">0:00.0</span></span></span>
    <span class="space"></span>
    <button class="cc" data-label="captions" data-key="c" aria-pressed="false" hidden>${icons.captions}</button>
    <button class="reset" data-label="home" data-key="0">${icons.home}</button>
    <button class="settings" data-label="settings" aria-haspopup="true" aria-expanded="false">${icons.menu}</button>
    <button class="fullscreen" data-label="fullscreen" data-key="f">${icons.full}</button>
  </div>
</div>
<div class="menu" part="menu" role="group" data-label="settings" hidden>
  <label for="detail" data-text="detail"></label><select id="detail"><option value="auto" data-text="auto"><option value="full" data-text="full"><option value="base" data-text="base"></select>
  <label for="level" data-text="motion"></label><select id="level"></select>
  <label for="rate" data-text="speed"></label><select id="rate"><option>0.25</option><option>0.5</option><option selected>1</option><option>1.5</option><option>2</option><option>4</option></select>
  <label for="mode" data-text="camera"></label><select id="mode"><option value="orbit" data-text="orbit"><option value="fly" data-text="fly"></select>
  <label for="captions" data-text="captions" hidden></label><select id="captions" hidden></select>
  <label for="loop" data-text="loop"></label><input type="checkbox" id="loop">
  <label for="numbers" data-text="numbers"></label><input type="checkbox" id="numbers">
  <div class="actions"><button class="link" data-text="link"></button><button class="pip" data-text="pip" hidden></button></div>
</div>
<div class="message" role="alert" hidden><b></b><p></p><button data-text="retry"></button></div>
<div class="note" part="note" role="status" hidden></div>
<div class="hint" aria-hidden="true"></div>
<div class="drop"></div>
<div class="said" role="status" aria-live="polite"></div>`;
