// SPDX-License-Identifier: Apache-2.0
// Numbers with units in attributes, as <model-viewer> has them.

/** @param {Record<string, number>} units what one of each is, '': of a number without a unit */
const reader = units => (/** @type {string | null | undefined} */ text) => {
  const [, number, unit] = /^([-+.\de]+)([a-z%]*)$/.exec(text?.trim() ?? '') ?? [];
  const value = Number(number) * units[unit];
  return Number.isFinite(value) ? value : undefined;
};

export const degree = Math.PI / 180;

/** Radians; undefined: `auto`, or no angle. */
export const angleOf = reader({'': degree, deg: degree, rad: 1});

/** Reads lengths, in units of the scene. @param {number | null | undefined} metresPerUnit null: one @param {number} whole 100 % */
export const lengthsOf = (metresPerUnit, whole) => {
  const metre = 1 / (metresPerUnit ?? 1);
  return reader({'': 1, m: metre, cm: metre / 100, mm: metre / 1000, '%': whole / 100});
};

/** @param {string | null | undefined} text */
export const wordsOf = text => text?.trim().split(/\s+/) ?? [];

/** A position; null: it is none. @param {string | null | undefined} text @param {ReturnType<typeof lengthsOf>} length */
export const pointOf = (text, length) => {
  const point = wordsOf(text).map(length);
  return point.length === 3 && point.every(v => v !== undefined) ? /** @type {import('./camera.js').Vec3} */ (point) : null;
};
