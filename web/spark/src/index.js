// SPDX-License-Identifier: Apache-2.0
export {followRules, ruleOptions} from './rules.js';
export {L4DSplats, sparkOptions} from './splats.js';
export {open, Movie, L4DError} from 'l4dcodec';
