// SPDX-License-Identifier: Apache-2.0
// The text of which all shaders are made, as JavaScript, against the table that tests of the other languages read.
import assert from 'node:assert/strict';
import {readFileSync} from 'node:fs';
import {test} from 'node:test';
import {glsl, shRules, sliceRules, usualRendering, wgsl} from '../src/rules.js';

const table = JSON.parse(readFileSync(new URL('../../../spec/examples/shading.json', import.meta.url), 'utf8'));

test('each term of SH is that of the specification', () => {
  assert.ok(table.sh.length >= 8);
  const rules = shRules.map(rule => new Function('x', 'y', 'z', 'x2', 'y2', 'z2', 'term', `return ${rule};`));
  for (const {direction: [x, y, z], basis} of table.sh) {
    let seen = 0;
    for (const [degree, rule] of rules.entries()) {
      for (let k = degree ** 2; k < (degree + 1) ** 2; ++k, ++seen) {
        const value = rule(x, y, z, x * x, y * y, z * z, term => (term === k ? 1 : 0)) - (degree === 0 ? 0.5 : 0);
        assert.ok(Math.abs(value - basis[k]) < 1e-15, `term ${k} of ${[x, y, z]}: ${value}, not ${basis[k]}`);
      }
    }
    assert.equal(seen, basis.length);
  }
});

test('what a Gaussian loses with time is what the specification says', () => {
  assert.ok(table.falloff.length >= 28);
  const rules = sliceRules({...usualRendering, minAlpha: 1e-9});
  assert.match(glsl(rules), /float age = 0\.0;[^]*return;/);
  assert.match(wgsl(rules), /var age: f32 = 0\.0;[^]*return false;/);
  const [ofOpacity] = rules.split('let position');
  const opacity = new Function('a', 'd', 'time', 'frame', 'exp',
                               `${ofOpacity.replace(/\b(let|var) (\w+): \w+/g, '$1 $2').replaceAll('skip;', 'return 0;')}
                                return opacity;`);
  for (const {lambda, dt, visible, falloff} of table.falloff) {
    const value = opacity({w: 0.5}, {z: 2, w: lambda}, 2 + dt, 0, Math.exp);
    if (visible) assert.ok(Math.abs(2 * value / falloff - 1) < 1e-9, `${lambda}, ${dt}: ${2 * value}, not ${falloff}`);
    else assert.equal(value, 0);
  }
});
