// SPDX-License-Identifier: Apache-2.0
// Playlists: those of the tool, and those that nobody should write.
import assert from 'node:assert/strict';
import {readFileSync} from 'node:fs';
import {join} from 'node:path';
import {test} from 'node:test';
import {appended, limits, parsePlaylist} from '../src/playlist.js';
import {Spans} from '../src/spans.js';
import {native} from './fixture.js';

const work = /** @type {string} */ (process.env.L4D_WORK);
const base = 'https://example.org/live/scene.m3u8';
const head = '#EXTM3U\n#EXT-X-TARGETDURATION:2\n';
const standing = '#EXT-X-L4D-STANDING:NUMBER=0,BEGIN=0,END=4,SHIFT=0,BYTERANGE="100@0",URI="a.l4d"\n';
/** @param {number} number @param {number} begin @param {string} [needs] */
const media = (number, begin, needs = '0') => `#EXT-X-L4D-MEMBER:NUMBER=${number},BEGIN=${begin},SHIFT=0.5,NEEDS="${needs}"\n` +
  `#EXTINF:2.000000,\n#EXT-X-BYTERANGE:50@${50 + 50 * number}\na.l4d\n`;

for (const name of ['members', 'joined']) {
  test(`${name}: the playlist says what the tool says of the file`, () => {
    const {members, complete} = parsePlaylist(readFileSync(join(work, `${name}.m3u8`)).toString(), base);
    const wanted = native('manifest', join(work, `${name}.l4d`)).members.filter((/** @type {any} */ m) => m.role !== 'index');
    assert.ok(complete);
    assert.equal(members.length, wanted.length);
    members.forEach((m, k) => {
      const w = wanted[k];
      assert.deepEqual([m.number, m.offset, m.bytes, m.begin, m.shift, m.isMedia, m.needs],
                       [w.number, w.offset, w.bytes, w.begin, w.shift, w.role === 'media', w.needs]);
      assert.ok(Math.abs(m.end - w.end) < 1e-6);
      assert.equal(m.url, `https://example.org/live/${name}.l4d`);
    });
  });
}

test('lines of others, URLs and ends in six decimals', () => {
  const text = `${head}# a comment\n#EXT-X-FUTURE:1\r\n\n${standing}${media(1, 0)}#EXT-X-L4D-MEMBER:NUMBER=7,BEGIN=2.0000005,SHIFT=-1e-3\n` +
    '#EXTINF:0.1,a title\nhttp://other.org/b.l4d?x=1\n';
  const {members, complete, targetDuration} = parsePlaylist(text, base);
  assert.deepEqual([complete, targetDuration, members.length], [false, 2, 3]);
  assert.deepEqual(members[2], {number: 7, begin: 2.0000005, end: 2.1000005, shift: -1e-3, needs: [], isMedia: true,
                                url: 'http://other.org/b.l4d?x=1', offset: 0, bytes: 0});
  assert.equal(members[1].end, 2.0000005, 'no gap between neighbours');
});

const good = head + standing + media(1, 0) + media(2, 2);
for (const [what, text, code] of /** @type {[string, string, string][]} */ ([
  ['no playlist', 'hello\n', 'PLAYLIST'], ['nothing', '', 'PLAYLIST'],
  ['no target duration', `#EXTM3U\n${standing}${media(1, 0)}`, 'PLAYLIST'],
  ['a huge target duration', good.replace('DURATION:2', 'DURATION:1e9'), 'PLAYLIST'],
  ['overlapping spans', head + standing + media(1, 0) + media(2, 1), 'PLAYLIST'],
  ['numbers that do not ascend', head + standing + media(2, 0) + media(2, 2), 'PLAYLIST'],
  ['a number that is too large', good.replace('NUMBER=2', 'NUMBER=4294967296'), 'PLAYLIST'],
  ['a need of itself', head + standing + media(1, 0, '1'), 'PLAYLIST'],
  ['a need of what comes later', head + media(1, 0, '3') + standing.replace('NUMBER=0', 'NUMBER=3'), 'PLAYLIST'],
  ['a need of a media member', head + standing + media(1, 0) + media(2, 2, '1'), 'PLAYLIST'],
  ['needs twice', head + standing + media(1, 0, '0,0'), 'PLAYLIST'],
  ['too many needs', head + standing + media(1, 0, Array.from({length: limits.needs + 1}, (_, k) => k).join()), 'LIMIT_EXCEEDED'],
  ['no range of bytes', good.replace('50@100', '50'), 'PLAYLIST'], ['an empty range', good.replace('50@100', '0@100'), 'PLAYLIST'],
  ['a range beyond all numbers', good.replace('50@100', '9007199254740991@1'), 'PLAYLIST'],
  ['a begin that is no number', good.replace('BEGIN=2', 'BEGIN=Infinity'), 'PLAYLIST'],
  ['an end before the begin', good.replace('END=4', 'END=-4'), 'PLAYLIST'],
  ['a duration of nothing', good.replace('EXTINF:2', 'EXTINF:0'), 'PLAYLIST'],
  ['a duration that vanishes', good.replace('BEGIN=2', 'BEGIN=1e15').replace(/EXTINF:2.0(?![^]*EXTINF)/, 'EXTINF:1e-9'), 'PLAYLIST'],
  ['a segment that says nothing of itself', `${good}a.l4d\n`, 'PLAYLIST'],
  ['a segment without an address', good.replace(/a\.l4d\n$/, ''), 'PLAYLIST'],
  ['an attribute twice', good.replace('NUMBER=2', 'NUMBER=2,NUMBER=3'), 'PLAYLIST'],
  ['an open quotation mark', good.replace('URI="a.l4d"', 'URI="a.l4d'), 'PLAYLIST'],
  ['another scheme', good.replace('URI="a.l4d"', 'URI="file:///etc/passwd"'), 'PLAYLIST'],
  ['code as an address', good.replace(/a\.l4d\n$/, 'javascript:alert(1)\n'), 'PLAYLIST'],
  ['a playlist of playlists', `${head}#EXT-X-STREAM-INF:BANDWIDTH=1\nb.m3u8\n`, 'FEATURE_UNSUPPORTED'],
  ['encryption', good.replace(standing, `#EXT-X-KEY:METHOD=AES-128\n${standing}`), 'FEATURE_UNSUPPORTED'],
  ['a beginning that is gone', `${good}#EXT-X-MEDIA-SEQUENCE:4\n`, 'FEATURE_UNSUPPORTED'],
  ['a long line', `${head}#${'x'.repeat(limits.lineCharacters)}\n`, 'LIMIT_EXCEEDED'],
  ['a long playlist', head + '\n'.repeat(limits.characters), 'LIMIT_EXCEEDED']
])) {
  test(`refused: ${what}`, () => assert.throws(() => parsePlaylist(text, base), {name: 'L4DError', code}));
}

test('whatever is cut or changed, there are members or an error of ours', () => {
  let parsed = 0;
  for (let k = 0; k < good.length; ++k) {
    for (const text of [good.slice(0, k), good.slice(0, k) + good.slice(k + 1), `${good.slice(0, k)}9${good.slice(k + 1)}`]) {
      try {
        const {members} = parsePlaylist(text, base);
        for (const m of members) assert.ok(m.end > m.begin && m.offset + m.bytes <= Number.MAX_SAFE_INTEGER);
        ++parsed;
      } catch (error) {
        assert.match(/** @type {any} */ (error).code, /^(PLAYLIST|FEATURE_UNSUPPORTED|LIMIT_EXCEEDED)$/, String(error));
      }
    }
  }
  assert.ok(parsed > 100, `${parsed}`);
});

test('a playlist that grows adds members, and is told from another one', () => {
  const before = parsePlaylist(head + standing + media(1, 0), base);
  assert.deepEqual(appended(before, parsePlaylist(good, base)).map(m => m.number), [2]);
  for (const other of [head, good.replace('100@0', '101@0'), good.replace('NUMBER=1', 'NUMBER=1').replace('BEGIN=0,SHIFT=0.5', 'BEGIN=0,SHIFT=0')]) {
    assert.throws(() => appended(before, parsePlaylist(other, base)), {code: 'CHANGED'});
  }
  // What a cache still has is waited out; a recording that has ended has all of its members.
  const later = parsePlaylist(good, base);
  const stale = head + standing + media(1, 0);
  assert.deepEqual(appended(later, parsePlaylist(stale, base)), []);
  assert.throws(() => appended(later, parsePlaylist(`${stale}#EXT-X-ENDLIST\n`, base)), {code: 'CHANGED'});
});

test('what is shown when: in spans, at borders, in gaps, outside', () => {
  const text = head + standing + media(1, 0) + media(2, 2, '') + media(4, 6);
  const spans = new Spans(parsePlaylist(text, base).members);
  for (const [time, number, shown] of [[-1, 1, 0], [0, 1, 0], [1.99, 1, 1.99], [2, 2, 2], [4, 2, 4], [4.5, 2, 4], [5, 2, 4],
                                       [5.01, 4, 6], [6, 4, 6], [9, 4, 8]]) {
    const at = spans.shownAt(time);
    assert.deepEqual([at.media.number, at.time], [number, shown], `${time} s`);
    assert.deepEqual(at.members.map(m => m.number), number === 2 ? [2] : [number, 0]);
  }
  assert.deepEqual([spans.begin, spans.end], [0, 8]);
});
