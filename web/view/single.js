// SPDX-License-Identifier: Apache-2.0
// All of the player in one module: web/build.sh makes l4d-player.js of it.
import './inline.js';
export * from './src/index.js';
