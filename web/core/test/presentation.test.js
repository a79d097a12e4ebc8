// SPDX-License-Identifier: Apache-2.0
// Presentations of several streams over HTTP, against `l4dcodec slice`, with faults, and while they grow.
import assert from 'node:assert/strict';
import {execFileSync} from 'node:child_process';
import {mkdtempSync, readFileSync, rmSync} from 'node:fs';
import {tmpdir} from 'node:os';
import {join} from 'node:path';
import {after, before, test} from 'node:test';
import {Presentation} from '../src/presentation.js';
import {Spans} from '../src/spans.js';
import {frameOfTime} from '../src/timeline.js';
import {read, tool, until, wasm} from './fixture.js';
import {serveFiles} from './server.js';

const work = /** @type {string} */ (process.env.L4D_WORK);
const names = ['members.l4d', 'members.m3u8', 'joined.l4d', 'joined.m3u8'];
/** @type {Map<string, Uint8Array>} */
let files;
/** @type {Awaited<ReturnType<typeof serveFiles>>} */
let server;
before(async () => {
  files = new Map(names.map(name => [name, read(join(work, name))]));
  server = await serveFiles(files);
});
after(() => server.close());

const utf8 = (/** @type {string} */ text) => new TextEncoder().encode(text);
const textOf = (/** @type {string} */ name) => new TextDecoder().decode(files.get(name));

/** @param {string} name @param {any} [options] */
const presentationOf = (name, options) => {
  /** @type {any[]} */
  const posts = [];
  const presentation = new Presentation(wasm, server.url + name, message => posts.push(message), options);
  const of = (/** @type {string} */ type) => posts.filter(p => p.type === type);
  /** What a view holds. @type {Map<string, any>} */
  const rows = new Map(), timelines = new Map();
  presentation.post = message => {
    posts.push(message);
    if (message.type === 'rows') rows.set(message.key, message);
    if (message.type === 'removed') rows.delete(message.key);
    if (message.type === 'stream') timelines.set(message.number, message.timeline);
  };
  return {presentation, posts, of, rows, timelines};
};

/** @param {number} time @param {any} [more] */
const goal = (time, more) => ({time, ahead: 3, detail: /** @type {const} */ ('auto'), ...more});

/** Gaussians that a view shows of the rows that it holds. @param {ReturnType<typeof presentationOf>} p @param {number} time */
const visible = (p, time) => {
  const shown = p.presentation.spans.shownAt(time);
  let count = 0;
  for (const {number, shift} of shown.members) {
    const timeline = p.timelines.get(number);
    if (!timeline) continue;  // lost
    const own = Math.min(Math.max(shown.time - shift, timeline.timeBegin), timeline.timeBegin + timeline.duration);
    for (const rows of [...p.rows.values()].filter(r => r.stream === number)) {
      for (let k = 0; k < rows.count; ++k) {
        const row = rows.geometry.subarray(16 * k, 16 * k + 16);
        const frame = frameOfTime(timeline, own);
        const age = row[15] * (own - rows.center - row[14]) ** 2;
        const isOn = row[15] < 0 ? row[14] <= frame && frame < -row[15] : age <= 16 && row[3] * Math.exp(-age / 2) >= 1 / 255;
        if (isOn) ++count;
      }
    }
  }
  return count;
};

/** Positions and SH of a PLY of the tool. @param {string} path */
const readPly = path => {
  const bytes = readFileSync(path);
  const header = bytes.subarray(0, bytes.indexOf('end_header\n') + 11);
  const names = [...header.toString().matchAll(/^property float (\w+)$/gm)].map(m => m[1]);
  const body = new Float32Array(bytes.buffer.slice(bytes.byteOffset + header.length, bytes.byteOffset + bytes.length));
  const count = body.length / names.length;
  const column = (/** @type {string} */ name) => {
    const at = names.indexOf(name);
    return Float32Array.from({length: count}, (_, k) => body[names.length * k + at]);
  };
  return {count, column};
};

for (const name of ['members', 'joined']) {
  test(`${name}: slices are those of the tool, in each member, at borders and beyond`, async () => {
    const folder = mkdtempSync(join(tmpdir(), 'l4dweb-'));
    const {presentation} = presentationOf(`${name}.m3u8`);
    try {
      const info = await presentation.open();
      const {media} = presentation.spans;
      const times = media.flatMap(({begin, end}) => [begin, begin + 0.37 * (end - begin), end - 1e-4]);
      times.push(info.timeBegin + info.duration);
      assert.ok(media.length >= 3);
      for (const time of times) {
        const path = join(folder, 'slice.ply');
        execFileSync(tool, ['slice', join(work, `${name}.l4d`), '--time', String(time), '-q', '-f', '-o', path]);
        const wanted = readPly(path);
        const got = await presentation.slice(time, {}, presentation.control.signal);
        assert.equal(got.count, wanted.count, `${time} s`);
        const terms = (got.shDegree + 1) ** 2;
        for (const [c, axis] of ['x', 'y', 'z'].entries()) {
          const column = wanted.column(axis), first = wanted.column(`f_dc_${c}`);
          const last = terms > 1 ? wanted.column(`f_rest_${(c + 1) * (terms - 1) - 1}`) : first;
          for (let k = 0; k < got.count; ++k) {
            assert.equal(got.position[3 * k + c], column[k]);
            assert.equal(got.sh?.[3 * terms * k + c], first[k]);
            assert.equal(got.sh?.[3 * terms * k + 3 * (terms - 1) + c], last[k]);
          }
        }
      }
    } finally {
      presentation.dispose();
      rmSync(folder, {recursive: true});
    }
  });

  test(`${name}: seeks show what slices hold, and say so once all of it is here`, async () => {
    let sent = 0;
    const p = presentationOf(`${name}.m3u8`, {fetch: (/** @type {[string]} */ ...given) => { ++sent; return fetch(...given); }});
    const info = await p.presentation.open();
    let id = 0;
    for (const share of [0.9, 0.1, 0.5, 0.501, 0.999, 0]) {
      const time = info.timeBegin + share * info.duration;
      p.presentation.want(goal(time, {id: ++id}), true);
      await until(() => p.of('ready').some(r => r.id === id && r.detail === 'full'), `${time} s`);
      const slice = await p.presentation.slice(time, {}, p.presentation.control.signal);
      const wanted = slice.opacity.filter(o => o >= 1 / 255).length;
      assert.ok(wanted > 0 && Math.abs(visible(p, time) - wanted) <= Math.max(2, wanted * 1e-3), `${visible(p, time)} of ${wanted} at ${time} s`);
    }
    assert.deepEqual(p.of('error'), []);
    // A view knows what does not fit, before it comes.
    if (name === 'joined') assert.equal(p.of('info').at(-1)?.info.shDegree, 3);
    for (const rows of p.of('rows').slice(-3)) assert.equal(rows.shStride, 48);
    // Read ahead ends, and then all is quiet.
    await until(() => [...p.presentation.active].every(part => part.isIdle), 'the end');
    assert.ok(p.of('ready').at(-1).until >= info.timeBegin + 3 - 1e-6, JSON.stringify(p.of('ready').at(-1)));
    const before = sent;
    assert.ok(before > 0);
    await new Promise(resolve => setTimeout(resolve, 100));
    assert.equal(sent, before);
    p.presentation.dispose();
  });
}

test('it plays across all borders without a picture that lacks rows', async () => {
  const p = presentationOf('members.m3u8');
  const info = await p.presentation.open();
  p.presentation.want(goal(info.timeBegin, {playing: true, id: 1}), true);
  for (let time = info.timeBegin; time < info.timeBegin + info.duration; time += 0.25) {
    p.presentation.want(goal(time, {playing: true}), false);
    await until(() => p.of('ready').at(-1)?.until >= time && p.of('ready').at(-1).from <= time, `${time} s`);
    const slice = await p.presentation.slice(time, {}, p.presentation.control.signal);
    const wanted = slice.opacity.filter(o => o >= 1 / 255).length;
    const got = visible(p, time);
    assert.ok(Math.abs(got - wanted) <= Math.max(2, wanted * 1e-3), `${got} of ${wanted} at ${time} s`);
  }
  assert.deepEqual(p.of('error'), []);
  // Each byte once, and the standing member has not been asked for again.
  const sum = p.presentation.statistics().bytes;
  assert.ok(sum <= 1.5 * /** @type {any} */ (files.get('members.l4d')).length, `${sum} bytes`);
  p.presentation.dispose();
});

test('memory stays flat over 300 seeks, and few members are open', async () => {
  const p = presentationOf('members.m3u8', {maxRows: 2 ** 16, cacheBytes: 2 ** 20});
  const info = await p.presentation.open();
  let memory = 0;
  for (let id = 1; id <= 300; ++id) {
    const time = info.timeBegin + info.duration * (id * 37 % 100) / 100;
    p.presentation.want(goal(time, {ahead: 0.2, id}), true);
    await until(() => p.of('ready').some(r => r.id === id && r.detail === 'full'), `seek ${id}`);
    const held = [...p.rows.values()].reduce((sum, r) => sum + 256 * Math.ceil(r.count / 256), 0);
    assert.ok(held <= 2 ** 16, `${held} rows`);
    assert.ok(p.presentation.parts.size <= 16, `${p.presentation.parts.size} parts`);
    p.posts.length = 0;
    if (id === 60) memory = p.presentation.statistics().memoryBytes;
  }
  const after = p.presentation.statistics().memoryBytes;
  assert.ok(after <= memory + 2 ** 20, `${memory} to ${after} bytes`);
  p.presentation.dispose();
});

test('between spans the ends of the nearest one are shown', async () => {
  const lines = textOf('members.m3u8').split('\n');
  const second = lines.findIndex((line, k) => line.startsWith('#EXT-X-L4D-MEMBER') && k > lines.findIndex(l => l.startsWith('#EXT-X-L4D-MEMBER')));
  lines.splice(second, 4);
  files.set('gap.m3u8', utf8(lines.join('\n')));
  const p = presentationOf('gap.m3u8');
  await p.presentation.open();
  const [first, next] = p.presentation.spans.media;
  assert.ok(next.begin - first.end > 0.5);
  const at = (/** @type {number} */ time) => p.presentation.slice(time, {}, p.presentation.control.signal);
  assert.deepEqual(await at(first.end + 0.1), await at(first.end));
  assert.deepEqual(await at(next.begin - 0.1), await at(next.begin));
  // Playing goes on over it.
  p.presentation.want(goal(first.begin, {playing: true, ahead: 4, id: 1}), true);
  await until(() => p.of('ready').some(r => r.until >= next.end - 1e-6), 'what comes after the gap');
  p.presentation.dispose();
});

test('a member that is damaged is a loss, and its neighbours play', async () => {
  const bytes = /** @type {Uint8Array} */ (files.get('members.l4d')).slice();
  files.set('damaged.l4d', bytes);
  files.set('damaged.m3u8', utf8(textOf('members.m3u8').replaceAll('members.l4d', 'damaged.l4d')));
  const {media} = (p => new Spans(p))(await (async () => {
    const {presentation} = presentationOf('damaged.m3u8');
    await presentation.open();
    presentation.dispose();
    return presentation.playlist.members;
  })());
  bytes[media[1].offset + 60] ^= 0x55;
  const p = presentationOf('damaged.m3u8');
  await p.presentation.open();
  p.presentation.want(goal(media[0].begin, {playing: true, id: 1}), true);
  await until(() => p.of('ready').some(r => r.until >= media[2].begin + 0.5), 'what comes after it');
  const [{losses: [loss]}] = p.of('loss');
  assert.equal(loss.member, media[1].number);
  assert.match(loss.code, /CORRUPT|CHECKSUM/);
  assert.deepEqual(p.of('error'), []);
  p.presentation.dispose();
  const strict = presentationOf('damaged.m3u8', {tolerant: false});
  await strict.presentation.open();
  strict.presentation.want(goal(media[1].begin, {id: 2}), true);
  await until(() => strict.of('error').length > 0, 'the error');
  assert.match(strict.of('error')[0].error.code, /CORRUPT|CHECKSUM/);
  strict.presentation.dispose();
});

/** A playlist in which the file of a segment is another one. @param {string} from @param {number} segment @param {string} to */
const withSegment = (from, segment, to) => {
  let k = 0;
  return utf8(textOf(from).replace(/^[\w.]+\.l4d$/gm, own => k++ === segment ? to : own));
};

test('a first segment that the server does not have is a loss, and playing begins with the next one', async () => {
  files.set('late.m3u8', withSegment('joined.m3u8', 0, 'late.l4d'));
  files.delete('late.l4d');
  const p = presentationOf('late.m3u8');
  const info = /** @type {any} */ (await p.presentation.open());
  const [lost, next] = p.presentation.spans.media;
  assert.deepEqual([info.timeBegin, info.playlist.startTime], [lost.begin, next.begin]);
  assert.deepEqual(p.of('loss').flatMap(l => l.losses), [{code: 'NOT_FOUND', clause: '', offset: -1, member: lost.number,
                                                        begin: lost.begin, end: lost.end, detailOnly: false}]);
  // Its own time shows nothing, and playing goes on from it.
  p.presentation.want(goal(lost.begin, {playing: true, id: 1}), true);
  await until(() => p.of('ready').some(r => r.id === 1 && r.until >= next.begin + 0.5), 'what comes after it');
  const slice = (/** @type {number} */ time) => p.presentation.slice(time, {}, p.presentation.control.signal);
  assert.deepEqual([(await slice(lost.begin)).count, (await slice(next.begin)).count > 0], [0, true]);
  assert.equal(p.of('loss').length, 1);
  assert.deepEqual(p.of('error'), []);
  // Once it is there, a seek shows it.
  files.set('late.l4d', /** @type {Uint8Array} */ (files.get('joined.l4d')));
  p.presentation.want(goal(lost.begin, {id: 2}), true);
  await until(() => p.of('ready').some(r => r.id === 2 && r.detail === 'full'), 'the first segment');
  assert.ok(visible(p, lost.begin) > 0);
  p.presentation.dispose();
  files.delete('late.l4d');
  const strict = presentationOf('late.m3u8', {tolerant: false});
  await assert.rejects(strict.presentation.open(), {code: 'NOT_FOUND'});
  strict.presentation.dispose();
});

test('a segment that goes away while it plays costs its span; what others need is shown with them', async () => {
  files.set('going.l4d', /** @type {Uint8Array} */ (files.get('members.l4d')));
  files.set('going.m3u8', withSegment('members.m3u8', 0, 'none.l4d'));
  const p = presentationOf('going.m3u8');
  const info = /** @type {any} */ (await p.presentation.open());
  // The standing member is there, so that playing begins with it.
  assert.equal(info.playlist.startTime, info.timeBegin);
  p.presentation.want(goal(info.timeBegin, {id: 1}), true);
  await until(() => p.of('ready').some(r => r.id === 1 && r.detail === 'full'), 'the standing member');
  assert.ok(visible(p, info.timeBegin) > 0);
  p.presentation.dispose();
  files.set('going.m3u8', withSegment('joined.m3u8', 1, 'going.l4d'));
  files.set('going.l4d', /** @type {Uint8Array} */ (files.get('joined.l4d')));
  const q = presentationOf('going.m3u8');
  await q.presentation.open();
  const [, second, third] = q.presentation.spans.media;
  q.presentation.want(goal(second.begin, {ahead: 0, detail: 'base', id: 1}), true);
  await until(() => q.of('ready').some(r => r.id === 1), 'the second, in base colours');
  files.delete('going.l4d');
  q.presentation.want(goal(second.begin, {ahead: 6, id: 2}), true);
  await until(() => q.of('ready').some(r => r.id === 2 && r.until >= third.begin + 0.5), 'the third');
  assert.deepEqual(q.of('error'), []);
  assert.deepEqual(q.of('loss').flatMap(l => l.losses).map(l => [l.member, l.code]), [[second.number, 'NOT_FOUND']]);
  q.presentation.dispose();
});

test('a file that grows is followed to its end', async () => {
  const whole = textOf('members.m3u8').replace(/TARGETDURATION:\d+/, 'TARGETDURATION:1');
  const bytes = /** @type {Uint8Array} */ (files.get('members.l4d'));
  const segments = whole.split('\n').flatMap((line, k) => line === 'members.l4d' ? [k] : []);
  const upTo = (/** @type {number} */ count) => whole.split('\n').slice(0, count ? segments[count - 1] + 1 : 5).join('\n')
    .replaceAll('members.l4d', 'growing.l4d').replace('TYPE:VOD', 'TYPE:EVENT') + '\n';
  const publish = (/** @type {number} */ count) => {
    const ranges = [...upTo(count).matchAll(/(\d+)@(\d+)/g)].map(m => Number(m[1]) + Number(m[2]));
    files.set('growing.l4d', bytes.subarray(0, Math.max(0, ...ranges)));
    files.set('growing.m3u8', utf8(upTo(count)));
  };
  publish(0);
  const p = presentationOf('growing.m3u8');
  const opening = p.presentation.open();
  await until(() => server.requests.some(r => r.name === 'growing.m3u8'), 'its playlist without a segment to be seen');
  publish(3);
  const info = /** @type {any} */ (await opening);
  assert.equal(info.playlist.live, true);
  assert.ok(Math.abs(info.duration - 3) < 1e-3, `${info.duration}`);
  assert.equal(info.playlist.startTime, p.presentation.spans.end - 2);
  p.presentation.want(goal(info.playlist.startTime, {playing: true, ahead: 6, id: 1}), true);
  await until(() => p.of('ready').some(r => r.until >= 3 - 1e-6), 'its end of now');
  publish(5);
  await until(() => p.of('grown').length === 1, 'more of it');
  assert.equal(p.of('grown')[0].live, true);
  await until(() => p.of('ready').some(r => r.until >= 5 - 1e-6), 'its new end');
  files.set('growing.l4d', bytes);
  files.set('growing.m3u8', utf8(whole.replaceAll('members.l4d', 'growing.l4d')));
  await until(() => p.of('grown').length === 2, 'all of it');
  assert.equal(p.of('grown')[1].live, false);
  const seen = server.requests.length;
  await new Promise(resolve => setTimeout(resolve, 1500));
  assert.ok(server.requests.slice(seen).every(r => r.name !== 'growing.m3u8'), 'the playlist is complete');
  assert.deepEqual(p.of('error'), []);
  p.presentation.dispose();
});

test('a playlist that becomes another one is told, and so is a server that is lost', async () => {
  const retries = [];
  files.set('live.m3u8', utf8(textOf('members.m3u8').replace('#EXT-X-ENDLIST\n', '').replace(/TARGETDURATION:\d+/, 'TARGETDURATION:1')));
  const p = presentationOf('live.m3u8', {onRetry: (/** @type {string} */ why) => retries.push(why)});
  const info = await p.presentation.open();
  const other = presentationOf('live.m3u8');
  await other.presentation.open();
  server.close();
  other.presentation.want(goal(info.timeBegin, {id: 1}), true);
  await until(() => other.of('error').length > 0, 'the error');
  assert.equal(other.of('error')[0].error.code, 'NETWORK');
  await until(() => retries.length > 0, 'another try');
  await server.again();
  // It is wanted again, as a player does that waits.
  other.presentation.want(goal(info.timeBegin, {id: 2}), true);
  await until(() => other.of('ready').some(r => r.id === 2), 'the picture');
  other.presentation.dispose();
  files.set('live.m3u8', utf8(textOf('joined.m3u8').replace('#EXT-X-ENDLIST\n', '')));
  await until(() => p.of('error').length > 0, 'the change');
  assert.equal(p.of('error')[0].error.code, 'CHANGED');
  p.presentation.dispose();
});

test('a seek is not answered with the failure of the one before', async () => {
  let fails = false, failures = 0, release = () => {};
  const held = new Promise(resolve => { release = () => resolve(undefined); });
  /** @type {any} */
  const p = presentationOf('joined.m3u8', {fetch: (/** @type {any[]} */ ...given) => {
    // The fourth is the last try.
    if (fails && ++failures <= 4) return (failures === 4 ? held : Promise.resolve()).then(() => { throw new TypeError('no network'); });
    return fetch(.../** @type {[string]} */ (given));
  }});
  await p.presentation.open();
  const {begin} = p.presentation.spans.media[2];
  fails = true;
  p.presentation.want(goal(begin, {id: 1}), true);
  await until(() => failures === 4, 'the last try');
  p.presentation.want(goal(begin, {id: 2}), true);
  release();
  await until(() => p.of('ready').some((/** @type {any} */ r) => r.id === 2 && r.detail === 'full'), 'the picture');
  assert.ok(failures > 4);
  assert.deepEqual(p.of('error'), []);
  p.presentation.dispose();
});

test('what cannot be played is refused with a reason', async () => {
  const refused = async (/** @type {string} */ name, /** @type {string} */ code) => {
    const {presentation} = presentationOf(name);
    await assert.rejects(presentation.open(), {code}, name);
    presentation.dispose();
  };
  await refused('missing.m3u8', 'NOT_FOUND');
  files.set('empty.m3u8', utf8('#EXTM3U\n#EXT-X-TARGETDURATION:2\n#EXT-X-ENDLIST\n'));
  await refused('empty.m3u8', 'PLAYLIST');
  files.set('lost.m3u8', utf8(textOf('members.m3u8').replaceAll('members.l4d', 'gone.l4d')));
  await refused('lost.m3u8', 'NOT_FOUND');
  files.set('short.l4d', /** @type {Uint8Array} */ (files.get('members.l4d')).subarray(0, 5000));
  files.set('cut.m3u8', utf8(textOf('members.m3u8').replaceAll('members.l4d', 'short.l4d')));
  await refused('cut.m3u8', 'TRUNCATED');
  server.faults.ranges = false;
  await refused('members.m3u8', 'NO_RANGES');
  server.faults.ranges = true;
});

test('headers go to the host of the playlist and to no other', async () => {
  const elsewhere = await serveFiles(files);
  try {
    files.set('elsewhere.m3u8', utf8(textOf('members.m3u8').replaceAll('members.l4d', `${elsewhere.url}members.l4d`)));
    const {presentation} = presentationOf('elsewhere.m3u8', {headers: {'x-secret': '1'}});
    await presentation.open();
    presentation.dispose();
    assert.equal(server.requests.at(-1)?.headers['x-secret'], '1');
    assert.ok(elsewhere.requests.length > 0 && elsewhere.requests.every(r => !('x-secret' in r.headers)));
  } finally {
    elsewhere.close();
  }
});
