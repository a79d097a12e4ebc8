// SPDX-License-Identifier: Apache-2.0
// Captions of <l4d-player>: children <track>, as of <video>.

const isCaption = (/** @type {TextTrack} */ track) => ['captions', 'subtitles'].includes(track.kind);

/** Whether a cue is shown at a time. @param {number} time @returns {(cue: TextTrackCue) => boolean} */
export const isAt = time => cue => cue.startTime <= time && time < cue.endTime;

/**
 * The text tracks of a player. A <video> that nobody sees loads and parses them, and says what scripts know of TextTrack; it plays
 * nothing, so the player itself says which cues are shown.
 */
export class Captions {
  /** @param {import('./element.js').L4DPlayer} player */
  constructor(player) {
    this.player = player;
    this.video = document.createElement('video');
    /** Of children of the player, those of the video. @type {Map<Element, HTMLTrackElement>} */
    this.copies = new Map();
    /** That toggle() shows again. @type {TextTrack | undefined} */
    this.last = undefined;
    /** Those that show again once the player is back. @type {TextTrack[]} */
    this.resting = [];
    /** @type {TextTrackCue[]} */
    this.shown = [];
    new MutationObserver(() => this.read()).observe(player, {
      childList: true, subtree: true, attributeFilter: ['kind', 'src', 'srclang', 'label', 'default']});
    for (const type of ['addtrack', 'removetrack', 'change']) this.video.textTracks.addEventListener(type, () => this.list());
    player.$('#captions').addEventListener('change', (/** @type {any} */ e) => this.choose(this.tracks[Number(e.target.value)]));
    player.$('.cc').addEventListener('click', () => this.toggle());
  }

  /** Those that can be read. */
  get tracks() { return [...this.video.textTracks].filter(isCaption); }
  get showing() { return this.tracks.filter(track => track.mode === 'showing'); }

  /** What loads the cues of a child. @param {string} kind @param {string} label */
  copyOf(kind, label) { return [...this.copies.values()].find(copy => copy.kind === kind && copy.label === label); }

  /** Children have come, gone or changed. */
  read() {
    this.video.crossOrigin = this.player.getAttribute('crossorigin') ?? 'anonymous';
    const children = [...this.player.children].filter(child => child.localName === 'track');
    for (const [child, copy] of this.copies) {
      if (children.includes(child) && child.isEqualNode(copy)) continue;
      copy.remove();
      this.copies.delete(child);
    }
    for (const child of children) if (!this.copies.has(child)) this.#add(/** @type {HTMLTrackElement} */ (child));
    this.list();
  }

  /** @param {HTMLTrackElement} child */
  #add(child) {
    const copy = /** @type {HTMLTrackElement} */ (child.cloneNode());
    this.copies.set(child, copy);
    for (const type of ['load', 'error']) {
      copy.addEventListener(type, () => {
        child.dispatchEvent(new Event(type));
        this.show();
      });
    }
    this.video.append(copy);
    // The browser shows it or not, by its attribute default and by what the reader prefers; Firefox only if it is of the first that come.
    if (!copy.default || !isCaption(copy.track)) return;
    setTimeout(() => { if (copy.parentNode && this.player.isConnected && this.showing.length === 0) copy.track.mode = 'showing'; });
  }

  /** While the player is in no page, nothing is shown: Chromium keeps a video with tracks that show in memory. @param {boolean} on */
  rest(on) {
    if (on) this.resting.push(...this.showing);
    for (const track of this.resting) track.mode = on ? 'disabled' : 'showing';
    if (!on) this.resting = [];
  }

  /** Shows one alone, or none. @param {TextTrack} [wanted] */
  choose(wanted) {
    for (const track of this.tracks) track.mode = track === wanted ? 'showing' : 'disabled';
    this.list();
  }

  /** Hides what is shown, or shows what was shown last, or else the reader's language. */
  toggle() {
    const {tracks, showing: [on], last} = this;
    const own = tracks.find(({language}) => language.split('-')[0] === this.player.texts.language.split('-')[0]);
    this.choose(on ? undefined : last && tracks.includes(last) ? last : own ?? tracks[0]);
  }

  /** Fills the controls. */
  list() {
    const {player, tracks, showing: [on]} = this;
    if (!player.isConnected) return this.rest(true);
    this.last = on ?? this.last;
    const names = new Intl.DisplayNames(player.texts.language, {type: 'language'});
    const nameOf = (/** @type {TextTrack} */ {label, language}) => {
      try {
        return label || names.of(language);
      } catch {
        return language || player.texts.say('captions');  // it is no tag of a language
      }
    };
    const select = player.$('#captions');
    select.replaceChildren(new Option(player.texts.say('off'), '-1'), ...tracks.map((track, k) => new Option(nameOf(track), String(k))));
    select.value = String(tracks.indexOf(on));
    for (const part of [select, select.labels[0], player.$('.cc')]) part.hidden = tracks.length === 0;
    player.$('.cc').setAttribute('aria-pressed', String(Boolean(on)));
    this.show();
  }

  /** Shows the cues of the time of now. */
  show() {
    const {currentTime, movie} = this.player;
    const cues = movie ? this.showing.flatMap(track => [...track.cues ?? []].filter(isAt(currentTime))) : [];
    if (cues.length === this.shown.length && cues.every((cue, k) => cue === this.shown[k])) return;
    this.shown = cues;
    this.player.$('.captions').replaceChildren(...cues.map(cue => {
      const line = document.createElement('p');
      line.append(/** @type {VTTCue} */ (cue).getCueAsHTML());
      return line;
    }));
  }
}
