// SPDX-License-Identifier: Apache-2.0
// Servers, and what is between them and the page, that say one thing and send another: the right picture or a reason, in time.
import assert from 'node:assert/strict';
import {after, before, test} from 'node:test';
import {gzipSync} from 'node:zlib';
import {Link, LocalLink} from '../src/link.js';
import {engineOf, read, streamOf, until} from './fixture.js';
import {serve} from './server.js';

const bytes = read(streamOf('long'));
const page = Buffer.from('<!doctype html><title>Sign in</title>'.padEnd(4096, ' '));
const isPart = (/** @type {Answer} */ {status}) => status === 206;
const rangeOf = (/** @type {Answer} */ {begin, end}, /** @type {any} */ size) => `bytes ${begin}-${end - 1}/${size}`;

/**
 * What each answer becomes, and the code that it leads to; '': the picture.
 * @typedef {import('./server.js').Answer} Answer @type {[string, (answer: Answer) => void, string][]}
 */
const lies = [
  ['a body that begins some bytes further on', a => { a.body = Buffer.concat([a.body.subarray(7), a.body.subarray(0, 7)]); }, 'NOT_L4D'],
  ['the first part, and then other bytes', a => { if (a.begin > 0) a.body = new Uint8Array(a.body.length).fill(7); }, 'CHECKSUM'],
  ['a page to sign in', a => { a.body = page; }, 'NOT_L4D'],
  ['a page to sign in after the first part', a => { if (a.begin > 0) a.body = page; }, 'CHECKSUM'],
  // As of a service worker that makes an answer of its own of the body.
  ['a part that claims to be all', a => { a.status = 200; delete a.headers['Content-Range']; }, 'TRUNCATED'],
  ['all of it that claims to be the part', a => { a.body = bytes; }, 'CHECKSUM'],
  ['more than the part', a => { if (isPart(a)) a.body = bytes.subarray(a.begin, a.end + 5000); }, ''],
  ['half of the part', a => { a.body = a.body.subarray(0, Math.ceil(a.body.length / 2)); }, ''],
  ['a part that is compressed on its way', a => { a.body = gzipSync(a.body); a.headers['Content-Encoding'] = 'gzip'; }, ''],
  ['all of it, compressed', a => { [a.status, a.body, a.headers] = [200, gzipSync(bytes), {'Content-Encoding': 'gzip'}]; }, ''],
  ['a size that is another one each time', a => { a.headers['Content-Range'] = rangeOf(a, bytes.length + a.begin % 1000); }, 'CHANGED'],
  ['a size that is too small', a => { a.headers['Content-Range'] = rangeOf(a, bytes.length >> 1); }, 'TRUNCATED'],
  ['a part without a size', a => { a.headers['Content-Range'] = rangeOf(a, '*'); }, ''],
  ['a part without a range', a => { a.headers['Content-Range'] = 'bytes */nothing'; }, '']
];

/** Opens and seeks. @param {any} link @param {string} [url] */
const show = async (link, url) => {
  const e = await engineOf(link, {failures: 2}, url);
  try {
    const {timeBegin, duration} = await e.engine.open();
    e.engine.seek(timeBegin + 0.8 * duration, 5);
    await until(() => e.state().id === 5 && e.state().detail === 'full' || e.of('error').length > 0, 'a picture or an error');
    return {e, failures: [...e.of('error').map(one => one.error), ...e.of('loss').flatMap(one => one.losses)]};
  } catch (error) {
    return {e, failures: [error]};
  } finally {
    e.engine.dispose();
  }
};

/** Rows with all their detail, by bucket. @param {any} e @returns {Map<string, any>} */
const rowsOf = e => new Map(e.of('rows').filter((/** @type {any} */ r) => r.detail === 0 && r.count > 0).map((/** @type {any} */ r) => [r.key, r]));

/** @type {Map<string, any>} */
let truth;
before(async () => { truth = rowsOf((await show(new LocalLink(bytes.slice().buffer))).e); });

for (const [name, lie, code] of lies) {
  test(name, async () => {
    const server = await serve(bytes, {lie});
    after(() => server.close());
    const {e, failures} = await show(new Link(server.url, {failures: 2}), server.url);
    assert.deepEqual([...new Set(failures.map(one => one.code))], code ? [code] : []);
    const rows = rowsOf(e);
    assert.ok(code !== '' || rows.size > 3);
    for (const [key, {count, geometry, sh}] of rows) {
      const whole = truth.get(key);
      if (!whole) continue;  // it was read ahead
      assert.ok(count <= whole.count, key);
      // Without the pages that are lost, or as it is.
      if (count === whole.count) assert.deepEqual([geometry, sh], [whole.geometry, whole.sh], key);
    }
  });
}
