// SPDX-License-Identifier: Apache-2.0
export {open, Movie} from './movie.js';
export {L4DError} from './errors.js';
