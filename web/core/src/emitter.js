// SPDX-License-Identifier: Apache-2.0

/** Events by name: on() returns what ends it. */
export class Emitter {
  constructor() {
    /** @type {Map<string, Set<(value: any) => void>>} */
    this.listeners = new Map();
  }

  /** @param {string} type @param {(value: any) => void} listener @returns {() => void} */
  on(type, listener) {
    if (!this.listeners.has(type)) this.listeners.set(type, new Set());
    this.listeners.get(type)?.add(listener);
    return () => this.off(type, listener);
  }

  /** @param {string} type @param {(value: any) => void} listener */
  off(type, listener) { this.listeners.get(type)?.delete(listener); }

  /** @param {string} type @param {any} [value] */
  emit(type, value) {
    for (const listener of [...this.listeners.get(type) ?? []]) {
      try {
        listener(value);
      } catch (error) {
        // Its own fault: other listeners and the caller go on, and the page hears of it.
        queueMicrotask(() => { throw error; });
      }
    }
  }
}
