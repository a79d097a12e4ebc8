// SPDX-License-Identifier: Apache-2.0

export const blockBytes = 4096;

/**
 * The bytes of a stream that have arrived, in whole blocks (the last one may be shorter). If there are more than `budget`,
 * the block whose last use is the longest ago goes first. Blocks that are used during a hold() stay until its end, also
 * beyond the budget: what cannot be here at the same time would be fetched again and again.
 */
export class ByteStore {
  /** @param {number} [budget] bytes */
  constructor(budget = 256 * 2 ** 20) {
    this.budget = budget;
    this.size = 0;
    /** @type {Map<number, {bytes: Uint8Array, used: number}>} in the order of their last use */
    this.blocks = new Map();
    this.holds = new Set();  // when those that have not ended began
    this.now = 0;            // counts holds
    /** @type {[number, number][]} what read() was asked for in vain since missed() */
    this.misses = [];
  }

  get bytes() { return this.blocks.size * blockBytes; }

  /** Begins a hold. Returns what ends it. @returns {() => void} */
  hold() {
    const began = ++this.now;
    this.holds.add(began);
    return () => {
      this.holds.delete(began);
      this.#trim();
    };
  }

  #trim() {
    const held = Math.min(...this.holds);
    for (const [block, {used}] of this.blocks) {
      if (this.bytes <= this.budget || used >= held) break;
      this.blocks.delete(block);
    }
  }

  /** @param {number} block @param {Uint8Array} bytes */
  #use(block, bytes) {
    this.blocks.delete(block);
    this.blocks.set(block, {bytes, used: this.now});
  }

  /** Counts as a use of what of these ranges is here. @param {[number, number][]} ranges */
  use(ranges) {
    for (const [offset, size] of ranges) {
      for (let block = Math.floor(offset / blockBytes); block * blockBytes < Math.min(offset + size, this.size); ++block) {
        const here = this.blocks.get(block);
        if (here) this.#use(block, here.bytes);
      }
    }
  }

  /**
   * Keeps whole blocks; parts of blocks at either end are dropped.
   * @param {number} offset @param {Uint8Array} bytes
   */
  supply(offset, bytes) {
    const end = offset + bytes.length;
    for (let block = Math.ceil(offset / blockBytes); ; ++block) {
      const begin = block * blockBytes;
      const blockEnd = Math.min(begin + blockBytes, this.size);
      if (begin >= end || blockEnd > end) break;
      this.#use(block, bytes.slice(begin - offset, blockEnd - offset));
    }
    this.#trim();
  }

  /**
   * Copies to `target` and returns how many bytes there were, fewer at the end of the stream; -1 where
   * some have not arrived.
   * @param {number} offset @param {Uint8Array} target
   */
  read(offset, target) {
    const end = Math.min(offset + target.length, this.size);
    if (end <= offset) return 0;
    if (!this.has(offset, end - offset)) {
      this.misses.push([offset, end - offset]);
      return -1;
    }
    for (let at = offset; at < end;) {
      const block = Math.floor(at / blockBytes);
      const {bytes} = /** @type {{bytes: Uint8Array}} */ (this.blocks.get(block));
      this.#use(block, bytes);
      const from = at - block * blockBytes;
      const part = bytes.subarray(from, Math.min(bytes.length, from + end - at));
      target.set(part, at - offset);
      at += part.length;
    }
    return end - offset;
  }

  /** @param {number} offset @param {number} size */
  has(offset, size) {
    const last = Math.floor((Math.min(offset + size, this.size) - 1) / blockBytes);
    for (let block = Math.floor(offset / blockBytes); block <= last; ++block) {
      if (!this.blocks.has(block)) return false;
    }
    return true;
  }

  /** What read() missed since the last call. @returns {[number, number][]} */
  missed() {
    const misses = this.misses;
    this.misses = [];
    return misses;
  }

  /**
   * What of these ranges has not arrived, in whole blocks, pieces less than `gap` bytes apart joined,
   * none longer than `most`. Where more than one may be left (`few`), only as many are joined as there are too many, the
   * nearest first, and neighbours.
   * @param {[number, number][]} ranges offset and size @param {number} gap @param {number} most @param {number} few
   * @returns {[number, number][]}
   */
  missing(ranges, gap = 16384, most = 2 ** 20, few = 1) {
    const pieces = this.#pieces(ranges, few > 1 ? gap / 8 : gap, most);
    return few > 1 ? joined(pieces, gap, most, few) : pieces;
  }

  /** @param {[number, number][]} ranges @param {number} gap @param {number} most */
  #pieces(ranges, gap, most) {
    const blocks = new Set();
    for (const [offset, size] of ranges) {
      const last = Math.floor((Math.min(offset + size, this.size) - 1) / blockBytes);
      for (let block = Math.floor(offset / blockBytes); block <= last; ++block) {
        if (!this.blocks.has(block)) blocks.add(block);
      }
    }
    /** @type {[number, number][]} */
    const pieces = [];
    for (const block of [...blocks].sort((a, b) => a - b)) {
      const begin = block * blockBytes;
      const end = Math.min(begin + blockBytes, this.size);
      const last = pieces.at(-1);
      if (last && begin - (last[0] + last[1]) <= gap && end - last[0] <= most) {
        last[1] = end - last[0];
      } else {
        pieces.push([begin, end - begin]);
      }
    }
    return pieces;
  }
}

/**
 * Joins pieces over the smallest gaps until `few` are left.
 * @param {[number, number][]} pieces in order @param {number} gap the largest to be bridged @param {number} most bytes
 * @param {number} few @returns {[number, number][]}
 */
const joined = (pieces, gap, most, few) => {
  const gaps = pieces.slice(1).map(([begin], k) => ({k: k + 1, gap: begin - pieces[k][0] - pieces[k][1]}));
  const small = gaps.filter(g => g.gap <= gap).sort((a, b) => a.gap - b.gap);
  const bridged = new Set(small.slice(0, Math.max(pieces.length - few, 0)).map(g => g.k));
  /** @type {[number, number][]} */
  const out = [];
  for (const [k, [begin, size]] of pieces.entries()) {
    const last = out.at(-1);
    if (last && bridged.has(k) && begin + size - last[0] <= most) last[1] = begin + size - last[0];
    else out.push([begin, size]);
  }
  return out;
};
