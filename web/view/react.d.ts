// SPDX-License-Identifier: Apache-2.0
// For React 18 and 19, whose JSX has elements of its own: import 'l4dcodec-player/react'.
import type {} from 'react';
import type {L4DPlayerAttributes} from './player.js';

declare module 'react' {
  namespace JSX {
    interface IntrinsicElements {
      'l4d-player': L4DPlayerAttributes;
    }
  }
}
