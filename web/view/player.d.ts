// SPDX-License-Identifier: Apache-2.0
// Types of the package: those of its modules, and <l4d-player> as documents know it.
import type {L4DPlayer} from './index.js';

export * from './index.js';

declare global {
  interface HTMLElementTagNameMap {
    'l4d-player': L4DPlayer;
  }
}
