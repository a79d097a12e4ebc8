// SPDX-License-Identifier: Apache-2.0
export {open, Movie} from './movie.js';
export {L4DError} from './errors.js';
export {frameOfTime} from './timeline.js';
export {inlined, startWorker, trustedHtml, workerError, workerFrom} from './workers.js';

/** @typedef {import('./movie.js').BucketRows} BucketRows */
/** @typedef {import('./movie.js').LiveOptions} LiveOptions */
/** @typedef {import('./movie.js').Loss} Loss */
/** @typedef {import('./movie.js').OpenOptions} OpenOptions */
/** @typedef {import('./movie.js').Slice} Slice */
/** @typedef {import('./timeline.js').StreamTime} StreamTime */
/** @typedef {import('./decoder.js').Rendering} Rendering */
/** @typedef {import('./decoder.js').Presentation} Presentation */
