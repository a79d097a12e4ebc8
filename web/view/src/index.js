// SPDX-License-Identifier: Apache-2.0
export {View} from './view.js';
export {OrbitCamera} from './camera.js';
export {L4DPlayer} from './element.js';
export {open, Movie, L4DError} from 'l4dcodec';
