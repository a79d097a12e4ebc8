// SPDX-License-Identifier: Apache-2.0
// Types of the package: those of its modules, and <l4d-player> as documents and JSX know it.
import type {L4DError, Movie, OpenOptions} from 'l4dcodec';
import type {L4DPlayer} from './index.js';

export * from './index.js';

type MediaEvent = 'abort' | 'canplay' | 'canplaythrough' | 'durationchange' | 'emptied' | 'ended' | 'loadeddata' | 'loadedmetadata' |
  'loadstart' | 'pause' | 'play' | 'playing' | 'progress' | 'ratechange' | 'seeked' | 'seeking' | 'stalled' | 'timeupdate' |
  'volumechange' | 'waiting';

export interface L4DPlayerEventMap extends Omit<HTMLElementEventMap, 'error' | MediaEvent>, Record<MediaEvent, Event> {
  open: CustomEvent<Movie>;
  error: CustomEvent<L4DError>;
  backend: CustomEvent<'webgl2' | 'webgpu'>;
  enterpictureinpicture: PictureInPictureEvent;
  leavepictureinpicture: PictureInPictureEvent;
  'camera-change': CustomEvent<{source: 'user-interaction' | 'automatic' | 'none'}>;
}

declare module './element.js' {
  interface L4DPlayer {
    addEventListener<K extends keyof L4DPlayerEventMap>(
      type: K, listener: (this: L4DPlayer, event: L4DPlayerEventMap[K]) => unknown, options?: boolean | AddEventListenerOptions): void;
    addEventListener(type: string, listener: EventListenerOrEventListenerObject, options?: boolean | AddEventListenerOptions): void;
    removeEventListener<K extends keyof L4DPlayerEventMap>(
      type: K, listener: (this: L4DPlayer, event: L4DPlayerEventMap[K]) => unknown, options?: boolean | EventListenerOptions): void;
    removeEventListener(type: string, listener: EventListenerOrEventListenerObject, options?: boolean | EventListenerOptions): void;
  }
}

/** Attributes of `<l4d-player>`. */
export interface L4DPlayerAttributes {
  src?: string;
  lang?: string;
  poster?: string;
  autoplay?: boolean;
  loop?: boolean;
  overlay?: boolean;
  preload?: 'none' | 'metadata' | 'auto';
  loading?: 'lazy' | 'eager';
  controls?: 'none';
  playback?: 'once' | 'loop' | 'ping-pong' | 'auto';
  camera?: 'orbit' | 'fly';
  gestures?: 'page' | 'all' | 'none';
  detail?: 'auto' | 'base' | 'full';
  backend?: 'webgl2' | 'webgpu' | 'auto';
  reload?: number | string | boolean;
  crossorigin?: 'anonymous' | 'use-credentials';
  headers?: string;
  bases?: string;
  cache?: RequestCache;
  timeout?: number | string;
  retries?: number | string;
  tolerant?: 'true' | 'false';
  playlist?: 'true' | 'false';
  live?: string;
  'cache-bytes'?: number | string;
  'max-rows'?: number | string;
  'camera-orbit'?: string;
  'camera-target'?: string;
  'field-of-view'?: string;
  'min-camera-orbit'?: string;
  'max-camera-orbit'?: string;
  'min-field-of-view'?: string;
  'max-field-of-view'?: string;
  'auto-rotate'?: boolean;
  'auto-rotate-delay'?: number | string;
  'rotation-per-second'?: string;
  'wasm-src'?: string;
  'worker-src'?: string;
  options?: OpenOptions;
  ref?: unknown;
  children?: unknown;
  slot?: string;
  class?: string;
  className?: string;
  id?: string;
  style?: unknown;
}

declare global {
  interface HTMLElementTagNameMap {
    'l4d-player': L4DPlayer;
  }
  namespace JSX {
    interface IntrinsicElements {
      'l4d-player': L4DPlayerAttributes;
    }
  }
}
