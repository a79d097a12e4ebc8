// SPDX-License-Identifier: Apache-2.0
// Playlists of several streams through WebAssembly over HTTP, each feature once, against `l4dcodec slice`.
import assert from 'node:assert/strict';
import {execFileSync} from 'node:child_process';
import {mkdtempSync, readFileSync, rmSync} from 'node:fs';
import {tmpdir} from 'node:os';
import {join} from 'node:path';
import {after, before, test} from 'node:test';
import {Link} from '../src/link.js';
import {frameOfTime} from '../src/timeline.js';
import {engineOf, read, tool, until} from './fixture.js';
import {serveFiles} from './server.js';

const work = /** @type {string} */ (process.env.L4D_WORK);
const names = ['members.l4d', 'members.m3u8', 'joined.l4d', 'joined.m3u8'];
const {signal} = new AbortController();
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

/** @param {string} name @param {any} [options] of the link, and of the engine */
const engineOver = async (name, options = {}) => {
  const url = server.url + name;
  const e = await engineOf(new Link(url, options), {...options, isPlaylist: true}, url);
  /** What a view holds. @type {Map<string, any>} */
  const rows = new Map(), timelines = new Map();
  e.engine.post = message => {
    e.posts.push(message);
    if (message.type === 'rows') rows.set(message.key, message);
    if (message.type === 'removed') rows.delete(message.key);
    if (message.type === 'stream') timelines.set(message.number, message.timeline);
  };
  return {...e, rows, timelines};
};
/** The media members of what open() says. @param {any} info */
const mediaOf = info => info.playlist.members.filter((/** @type {any} */ m) => !m.isStanding);

/** Gaussians that a view shows of the rows that it holds. @param {Awaited<ReturnType<typeof engineOver>>} e @param {number} time */
const visible = (e, time) => {
  const shown = e.engine.decoder.shown();
  const at = shown.findIndex(m => !m.isStanding && m.begin <= time && (time < m.end || m.end === shown.at(-1)?.end));
  let count = 0;
  for (let k = at; k < shown.length && (k === at || shown[k].isStanding); ++k) {
    const {stream, shift} = shown[k];
    const timeline = e.timelines.get(stream);
    if (!timeline) continue;  // lost
    const own = Math.min(Math.max(time - shift, timeline.timeBegin), timeline.timeBegin + timeline.duration);
    for (const rows of [...e.rows.values()].filter(r => r.stream === stream)) {
      for (let i = 0; i < rows.count; ++i) {
        const row = rows.geometry.subarray(16 * i, 16 * i + 16);
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
  test(`${name}: slices are those of the tool, in each member, at borders and at the end`, async () => {
    const folder = mkdtempSync(join(tmpdir(), 'l4dweb-'));
    const {engine} = await engineOver(`${name}.m3u8`, {slices: true, ahead: 0.5});
    try {
      const info = await engine.open();
      const media = mediaOf(info);
      const times = media.flatMap((/** @type {any} */ {begin, end}) => [begin, begin + 0.37 * (end - begin), end - 1e-4]);
      times.push(info.timeBegin + info.duration);
      assert.ok(media.length >= 3);
      for (const time of times) {
        const path = join(folder, 'slice.ply');
        execFileSync(tool, ['slice', join(work, `${name}.l4d`), '--time', String(time), '-q', '-f', '-o', path]);
        const wanted = readPly(path);
        const got = await engine.slice(time, {}, signal);
        assert.equal(got.count, wanted.count, `${time} s`);
        const terms = (got.shDegree + 1) ** 2;
        for (const [c, axis] of ['x', 'y', 'z'].entries()) {
          const column = wanted.column(axis), first = wanted.column(`f_dc_${c}`);
          for (let k = 0; k < got.count; ++k) {
            assert.equal(got.position[3 * k + c], column[k]);
            assert.equal(got.sh?.[3 * terms * k + c], first[k]);
          }
        }
      }
    } finally {
      engine.dispose();
      rmSync(folder, {recursive: true});
    }
  });

  test(`${name}: seeks show what slices hold, and playing crosses borders without a picture that lacks rows`, async () => {
    const e = await engineOver(`${name}.m3u8`);
    const slices = await engineOver(`${name}.m3u8`, {slices: true, ahead: 0.5});
    const info = await e.engine.open();
    await slices.engine.open();
    const isWhole = async (/** @type {number} */ time) => {
      const slice = await slices.engine.slice(time, {}, signal);
      const wanted = slice.opacity.filter(o => o >= 1 / 255).length;
      const got = visible(e, time);
      assert.ok(wanted > 0 && Math.abs(got - wanted) <= Math.max(2, wanted * 1e-3), `${got} of ${wanted} at ${time} s`);
    };
    let id = 0;
    for (const share of [0.9, 0.1, 0.5, 0.501, 0.999, 0]) {
      const time = info.timeBegin + share * info.duration;
      e.engine.seek(time, ++id);
      await until(() => e.state().id === id && e.state().detail === 'full', `${time} s`);
      await isWhole(time);
    }
    // A view knows what does not fit, before it comes.
    if (name === 'joined') assert.equal(e.of('info').at(-1)?.info.shDegree, 3);
    for (const rows of e.of('rows').slice(-3)) assert.equal(rows.shStride, 48);
    e.engine.setMotion(4, 0);
    e.engine.command('play');
    await until(() => e.state().hasEnded, 'the end');
    await isWhole(info.timeBegin + info.duration);
    assert.ok(e.of('state').every(s => !s.isPlaying || s.detail !== 'none'));
    assert.deepEqual(e.of('error'), []);
    for (const {engine} of [e, slices]) engine.dispose();
  });
}

/** A playlist in which the file of a segment is another one. @param {string} from @param {number} segment @param {string} to */
const withSegment = (from, segment, to) => {
  let k = 0;
  return utf8(textOf(from).replace(/^[\w.]+\.l4d$/gm, own => k++ === segment ? to : own));
};

test('a member that is damaged or absent is a loss, and its neighbours play', async () => {
  files.set('late.m3u8', withSegment('joined.m3u8', 1, 'late.l4d'));
  const e = await engineOver('late.m3u8');
  const info = await e.engine.open();
  const [first, lost, third] = mediaOf(info);
  e.engine.seek(first.begin, 1);
  e.engine.setMotion(4, 0);
  e.engine.command('play');
  await until(() => e.state().time > third.begin || e.state().until > third.begin + 0.5, 'what comes after it');
  const [loss] = e.of('loss').flatMap(l => l.losses);
  assert.deepEqual(loss, {code: 'NOT_FOUND', clause: '', offset: -1, member: lost.stream, begin: lost.begin, end: lost.end, detailOnly: false});
  assert.deepEqual(e.of('error'), []);
  e.engine.dispose();
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
  const e = await engineOver('growing.m3u8');
  const opening = e.engine.open();
  await until(() => server.requests.some(r => r.name === 'growing.m3u8'), 'a look at the playlist');
  publish(3);
  const info = /** @type {any} */ (await opening);
  assert.equal(info.playlist.live, true);
  assert.ok(Math.abs(info.duration - 3) < 1e-3, `${info.duration}`);
  assert.ok(Math.abs(info.playlist.startTime - 1) < 1e-3, `${info.playlist.startTime}`);
  e.engine.command('play');
  await until(() => e.state().until >= 3 - 1e-3, 'its end of now');
  publish(5);
  await until(() => e.of('grown').length === 1, 'more of it');
  assert.equal(e.of('grown')[0].live, true);
  await until(() => e.state().until >= 5 - 1e-3, 'its new end');
  files.set('growing.l4d', bytes);
  files.set('growing.m3u8', utf8(whole.replaceAll('members.l4d', 'growing.l4d')));
  await until(() => e.of('grown').some(g => !g.live), 'all of it');
  assert.deepEqual(e.of('error'), []);
  e.engine.dispose();
});

test('a recording that stops growing is stale, and one that begins anew is followed', async () => {
  const lines = textOf('members.m3u8').replace(/TARGETDURATION:\d+/, 'TARGETDURATION:1').replace('TYPE:VOD', 'TYPE:EVENT').split('\n')
    .filter(line => !line.startsWith('#EXT-X-L4D-STREAM'));
  const ends = lines.flatMap((line, k) => line === 'members.l4d' ? [k + 1] : []);
  const upTo = (/** @type {number} */ count, /** @type {number} */ number) =>
    utf8([lines[0], `#EXT-X-L4D-STREAM:${number}`, ...lines.slice(1, ends[count - 1])].join('\n') + '\n');
  files.set('stops.m3u8', upTo(5, 1));
  const e = await engineOver('stops.m3u8', {live: {distance: 1.5, staleAfter: 2}});
  const info = /** @type {any} */ (await e.engine.open());
  assert.ok(Math.abs(info.playlist.startTime - 3.5) < 1e-3, `${info.playlist.startTime}`);
  e.engine.command('play');
  const states = () => e.of('live').map((/** @type {any} */ m) => m.state);
  await until(() => states().at(-1) === 'stale', 'that it is stale');
  files.set('stops.m3u8', upTo(2, 2));
  await until(() => states().includes('restarted'), 'that it began anew');
  await until(() => e.state().until <= 2 + 1e-3 && e.state().from > -1, 'what is recorded now');
  assert.deepEqual(e.of('error'), []);
  e.engine.dispose();
});

test('what cannot be played is refused with a reason', async () => {
  const refused = async (/** @type {string} */ name, /** @type {string} */ code) => {
    const {engine} = await engineOver(name, {failures: 2});
    await assert.rejects(engine.open(), {code}, name);
    engine.dispose();
  };
  await refused('missing.m3u8', 'NOT_FOUND');
  files.set('empty.m3u8', utf8('#EXTM3U\n#EXT-X-TARGETDURATION:2\n#EXT-X-ENDLIST\n'));
  await refused('empty.m3u8', 'PLAYLIST');
  files.set('lost.m3u8', utf8(textOf('members.m3u8').replaceAll('members.l4d', 'gone.l4d')));
  await refused('lost.m3u8', 'NOT_FOUND');
  server.faults.ranges = false;
  await refused('members.m3u8', 'NO_RANGES');
  server.faults.ranges = true;
});

test('headers go to the host of the playlist and to no other', async () => {
  const elsewhere = await serveFiles(files);
  try {
    files.set('elsewhere.m3u8', utf8(textOf('members.m3u8').replaceAll('members.l4d', `${elsewhere.url}members.l4d`)));
    const {engine} = await engineOver('elsewhere.m3u8', {headers: {'x-secret': '1'}});
    await engine.open();
    engine.dispose();
    assert.equal(server.requests.at(-1)?.headers['x-secret'], '1');
    assert.ok(elsewhere.requests.length > 0 && elsewhere.requests.every(r => !('x-secret' in r.headers)));
  } finally {
    elsewhere.close();
  }
});
