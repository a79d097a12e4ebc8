// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import {test} from 'node:test';
import {RowLines} from '../src/lines.js';

/** @param {string} key @param {number} lines that it takes */
const bucket = (key, lines) => /** @type {any} */ ({key, count: 256 * lines - 255, center: 0, stream: 0});

test('buckets that go keep their lines until no order names them', () => {
  const rows = new RowLines(4, true);
  assert.deepEqual([...rows.take(bucket('a', 2)) ?? []], [0, 1]);
  const asked = rows.gone;
  // A later one of the same key lies elsewhere.
  assert.deepEqual([...rows.take(bucket('a', 1)) ?? []], [2]);
  assert.ok(rows.isWhole(asked, new Set([0])));
  rows.release(asked);
  assert.deepEqual([...rows.take(bucket('b', 1)) ?? []], [3]);
  rows.release(rows.gone);
  assert.deepEqual([...rows.take(bucket('c', 2)) ?? []], [0, 1]);
  assert.equal(rows.take(bucket('d', 1)), null);
});

test('without other room they give their lines up, the oldest first, and orders that name them are not whole', () => {
  const rows = new RowLines(3, true);
  for (const key of ['a', 'b', 'c']) rows.take(bucket(key, 1));
  const asked = rows.gone;
  rows.remove('b');
  rows.remove('a');
  assert.deepEqual([...rows.take(bucket('d', 1)) ?? []], [1]);
  assert.ok(!rows.isWhole(asked, new Set([0, 1])));
  assert.ok(rows.isWhole(asked, new Set([0, 2])), 'what was not in it may go');
  const later = rows.gone;
  assert.ok(rows.isWhole(later, new Set([1])), 'those of an order that was asked for since then lie there');
  rows.release(later);
  assert.deepEqual(rows.lost, []);
  assert.deepEqual([...rows.take(bucket('e', 1)) ?? []], [0]);
});

test('where no order names rows, lines are free at once', () => {
  const rows = new RowLines(1, false);
  rows.take(bucket('a', 1));
  rows.remove('a');
  assert.deepEqual([...rows.take(bucket('b', 1)) ?? []], [0]);
});
