// SPDX-License-Identifier: Apache-2.0
export {L4DSplats} from './splats.js';
export {open, Movie, L4DError} from 'l4dcodec';
