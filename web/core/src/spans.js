// SPDX-License-Identifier: Apache-2.0

/** @typedef {import('./playlist.js').Member} Member */

/** Which members of a presentation are shown when: section 20.2 of the specification. */
export class Spans {
  /** @param {Member[]} members */
  constructor(members) {
    /** @type {Member[]} in the order of time */
    this.media = [];
    /** @type {Map<number, Member>} */
    this.byNumber = new Map();
    this.add(members);
  }

  /** @param {Member[]} members that follow */
  add(members) {
    for (const member of members) {
      this.byNumber.set(member.number, member);
      if (member.isMedia) this.media.push(member);
    }
  }

  get begin() { return this.media[0]?.begin ?? 0; }
  get end() { return this.media.at(-1)?.end ?? 0; }

  /** The media member of a time: where there is none, the one whose span is nearest. @param {number} time */
  indexAt(time) {
    let low = 0, high = this.media.length;  // the first that begins later
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.media[middle].begin > time) high = middle;
      else low = middle + 1;
    }
    const [before, after] = [this.media[low - 1], this.media[low]];
    if (!before) return 0;
    return after && time >= before.end && after.begin - time < time - before.end ? low : low - 1;
  }

  /** It and those that it needs. @param {Member} media */
  with(media) { return [media, ...media.needs.map(n => /** @type {Member} */ (this.byNumber.get(n)))]; }

  /**
   * What is shown at a time: between spans, what is seen at their ends.
   * @param {number} time @returns {{media: Member, members: Member[], time: number}}
   */
  shownAt(time) {
    const media = this.media[this.indexAt(time)];
    return {media, members: this.with(media), time: Math.min(Math.max(time, media.begin), media.end)};
  }
}
