// SPDX-License-Identifier: Apache-2.0
// Playlists of files of several streams: HLS with the tags of `l4dcodec manifest` and `encode --live --playlist`.
// What a playlist says decides on requests and memory, so all of it is checked.
import {L4DError} from './errors.js';

/**
 * @typedef {object} Member a stream of the presentation
 * @property {number} number its name; ascends in the order of the file
 * @property {number} begin @property {number} end seconds of the presentation
 * @property {number} shift time in the presentation less time in the stream
 * @property {number[]} needs numbers of the standing members that are shown with it
 * @property {boolean} isMedia false: it is shown with those that need it
 * @property {string} url @property {number} offset @property {number} bytes of it at this URL; 0: all of it
 */
/**
 * @typedef {object} Playlist
 * @property {Member[]} members in the order of the file
 * @property {boolean} complete nothing is appended any more
 * @property {number} targetDuration seconds after which a playlist that grows may be another one
 */

export const limits = Object.freeze({characters: 2 ** 24, members: 200_000, needs: 64, lineCharacters: 8192});

/** Spans end where EXTINF says, in six decimals: ends this close to the next begin are that begin. */
const rounding = 2e-6;
const mostSeconds = 2 ** 60;

/** Tags that change what a segment is. A playlist with them is not one of members. */
const refused = ['EXT-X-KEY', 'EXT-X-MAP', 'EXT-X-GAP', 'EXT-X-SKIP', 'EXT-X-STREAM-INF', 'EXT-X-PART'];

/** @param {string} text "A=1,B="x,y"" @returns {Map<string, string> | null} null: this is no list of attributes */
const attributesOf = text => {
  /** @type {Map<string, string>} */
  const found = new Map();
  const one = /([A-Z0-9-]+)=(?:"([^"]*)"|([^",\s]+))(,|$)/y;
  while (one.lastIndex < text.length) {
    const match = one.exec(text);
    if (!match || found.has(match[1])) return null;
    found.set(match[1], match[2] ?? match[3]);
    if (match[4] === '' || one.lastIndex === text.length) return match[4] === '' ? found : null;
  }
  return null;
};

/** One parse: what has been read so far. */
class Parser {
  /** @param {string} url of the playlist */
  constructor(url) {
    this.url = url;
    this.line = 0;
    /** @type {Member[]} */
    this.members = [];
    /** @type {Set<number>} */
    this.standing = new Set();
    /** @type {Member | null} */
    this.lastMedia = null;
    this.complete = false;
    this.targetDuration = 0;
    // Of the segment whose URL is still to come.
    /** @type {Map<string, string> | null} */
    this.media = null;
    this.duration = 0;
    /** @type {[number, number] | null} */
    this.range = null;
  }

  /** @param {string} why @param {string} [code] @returns {never} */
  fail(why, code = 'PLAYLIST') { throw new L4DError(code, `${this.url}, line ${this.line}: ${why}`); }

  /** @param {string | undefined} text @param {string} name */
  number(text, name) {
    const value = /^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$/.test(text ?? '') ? Number(text) : NaN;
    return Math.abs(value) <= mostSeconds ? value : this.fail(`${name} is no number of seconds`);
  }

  /** @param {string | undefined} text @param {string} name @param {number} most */
  count(text, name, most = Number.MAX_SAFE_INTEGER) {
    const value = /^\d{1,16}$/.test(text ?? '') ? Number(text) : NaN;
    return value <= most ? value : this.fail(`${name} is no whole number up to ${most}`);
  }

  /** @param {string} text "N@O" @returns {[number, number]} offset and bytes */
  byteRange(text) {
    const [bytes, offset, ...more] = text.split('@');
    if (more.length > 0) this.fail('a range of bytes is N@O');
    const range = /** @type {[number, number]} */ ([this.count(offset, 'an offset'), this.count(bytes, 'a size')]);
    if (range[1] === 0 || range[0] + range[1] > Number.MAX_SAFE_INTEGER) this.fail('a range of bytes is empty or too long');
    return range;
  }

  /** @param {string} reference */
  address(reference) {
    let url;
    try {
      url = new URL(reference, this.url);
    } catch {
      return this.fail('a URL cannot be resolved');
    }
    return /^https?:$/.test(url.protocol) ? url.href : this.fail(`a member is at ${url.protocol}`);
  }

  /** @param {Map<string, string> | null} attributes @param {Partial<Member>} rest */
  add(attributes, rest) {
    if (!attributes) return this.fail('no list of attributes');
    if (this.members.length >= limits.members) return this.fail(`more than ${limits.members} members`, 'LIMIT_EXCEEDED');
    const number = this.count(attributes.get('NUMBER'), 'NUMBER', 2 ** 32 - 1);
    if (number <= (this.members.at(-1)?.number ?? -1)) this.fail('numbers of members ascend');
    const begin = this.number(attributes.get('BEGIN'), 'BEGIN');
    const shift = this.number(attributes.get('SHIFT'), 'SHIFT');
    this.members.push(/** @type {Member} */ ({number, begin, shift, needs: [], ...rest}));
    return /** @type {Member} */ (this.members.at(-1));
  }

  /** @param {string} text of EXT-X-L4D-STANDING */
  addStanding(text) {
    const attributes = attributesOf(text);
    const [offset, bytes] = this.byteRange(attributes?.get('BYTERANGE') ?? '');
    const member = this.add(attributes, {isMedia: false, url: this.address(attributes?.get('URI') ?? ''), offset, bytes});
    member.end = this.number(attributes?.get('END'), 'END');
    if (!(member.end > member.begin)) this.fail('END is not after BEGIN');
    this.standing.add(member.number);
  }

  /** @param {string} reference the URL of a segment */
  addMedia(reference) {
    const {media, duration, range, lastMedia: before} = this;
    if (!media) return this.fail('a segment without EXT-X-L4D-MEMBER');
    if (!(duration > 0)) return this.fail('a segment without a duration');
    const member = this.add(media, {isMedia: true, url: this.address(reference), offset: range?.[0] ?? 0, bytes: range?.[1] ?? 0});
    member.end = member.begin + duration;
    if (!(member.end > member.begin)) this.fail('a segment that is too short for its time');
    member.needs = this.needs(media.get('NEEDS') ?? '', member.number);
    if (before && Math.abs(member.begin - before.end) <= rounding && member.begin > before.begin) before.end = member.begin;
    if (before && member.begin < before.end) this.fail('spans of media members overlap');
    this.lastMedia = member;
    this.media = this.range = null;
    this.duration = 0;
  }

  /** @param {string} text "0,4" @param {number} own */
  needs(text, own) {
    if (text === '') return [];
    const numbers = text.split(',', limits.needs + 1).map(n => this.count(n, 'NEEDS', 2 ** 32 - 1));
    if (numbers.length > limits.needs) this.fail(`a member needs more than ${limits.needs}`, 'LIMIT_EXCEEDED');
    numbers.forEach((n, k) => {
      if (k > 0 && n <= numbers[k - 1]) this.fail('NEEDS does not ascend');
      if (n >= own || !this.standing.has(n)) this.fail(`member ${n}, which is needed, is no standing member before it`);
    });
    return numbers;
  }

  /** @param {string} name @param {string} value */
  tag(name, value) {
    if (refused.includes(name)) this.fail(`${name} is not supported`, 'FEATURE_UNSUPPORTED');
    if (name === 'EXT-X-L4D-STANDING') this.addStanding(value);
    else if (name === 'EXT-X-L4D-MEMBER') this.media = attributesOf(value) ?? this.fail('no list of attributes');
    else if (name === 'EXTINF') this.duration = this.number(value.split(',')[0], 'EXTINF');
    else if (name === 'EXT-X-BYTERANGE') this.range = this.byteRange(value);
    else if (name === 'EXT-X-TARGETDURATION') this.targetDuration = this.count(value, name, 86400);
    else if (name === 'EXT-X-ENDLIST') this.complete = true;
    else if (name === 'EXT-X-MEDIA-SEQUENCE' && this.count(value, name) !== 0) {
      this.fail('the beginning of the playlist is gone', 'FEATURE_UNSUPPORTED');
    }
  }

  /** @param {string} line */
  read(line) {
    ++this.line;
    if (line.length > limits.lineCharacters) this.fail('a line is too long', 'LIMIT_EXCEEDED');
    if (this.line === 1 && line !== '#EXTM3U') this.fail('this is no playlist');
    const tag = /^#(EXT[A-Z0-9-]*)(?::(.*))?$/.exec(line);
    if (tag) this.tag(tag[1], tag[2] ?? '');
    else if (line !== '' && !line.startsWith('#')) this.addMedia(line);
  }
}

/**
 * Fails with PLAYLIST where a rule is broken, FEATURE_UNSUPPORTED, or LIMIT_EXCEEDED.
 * @param {string} text @param {string} url of the playlist @returns {Playlist}
 */
export const parsePlaylist = (text, url) => {
  const parser = new Parser(url);
  if (text.length > limits.characters) parser.fail('the playlist is too long', 'LIMIT_EXCEEDED');
  for (const line of text.split('\n')) parser.read(line.replace(/\r$/, ''));
  if (parser.media || parser.range || parser.duration > 0) parser.fail('the last segment has no URL');
  if (parser.targetDuration === 0) parser.fail('no EXT-X-TARGETDURATION');
  const {members, complete, targetDuration} = parser;
  return {members, complete, targetDuration};
};

/**
 * What a later version of a playlist adds. Fails with CHANGED where it is not the one before and more. An earlier
 * version, as a cache may still have it, adds nothing.
 * @param {Playlist} before @param {Playlist} after @returns {Member[]}
 */
export const appended = (before, after) => {
  const keys = /** @type {const} */ (['number', 'begin', 'shift', 'url', 'offset', 'bytes']);
  const isEarlier = !after.complete && after.members.length > 0 && after.members.length < before.members.length;
  const common = isEarlier ? before.members.slice(0, after.members.length) : before.members;
  const same = common.every((m, k) => after.members[k] && keys.every(key => after.members[k][key] === m[key]));
  if (!same) throw new L4DError('CHANGED', 'the playlist is another one now');
  return after.members.slice(before.members.length);
};

/**
 * Fetches a playlist.
 * @param {string} url @param {import('./link.js').Link} link @param {AbortSignal} signal
 */
export const loadPlaylist = (url, link, signal) => link.insist(async () => {
  const answer = await link.send(url, signal, {cache: link.revalidated});
  // Of another address after a redirection, which references are relative to.
  return parsePlaylist(await textOf(answer, url), answer.response.redirected ? answer.response.url : url);
}, signal);

/** @param {import('./link.js').Answer} answer @param {string} url */
const textOf = async (answer, url) => {
  const decoder = new TextDecoder();
  let text = '';
  for await (const piece of answer.pieces()) {
    text += decoder.decode(piece, {stream: true});
    if (text.length > limits.characters) throw new L4DError('LIMIT_EXCEEDED', `${url}: the playlist is too long`);
  }
  return text + decoder.decode();
};
