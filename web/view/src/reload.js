// SPDX-License-Identifier: Apache-2.0
// Players that load their file again when it has become another one: of a training that goes on, or of an encode that is tried again.

const leastSeconds = 0.5, usualSeconds = 2;

/** What tells one version of a file from another; '': nothing does, or the server does not answer. @param {string} url */
const versionOf = url => fetch(url, {method: 'HEAD', cache: 'no-store'})
  .then(({ok, headers}) => ok && (headers.get('ETag') ?? headers.get('Last-Modified')) || '').catch(() => '');

/**
 * Looks for another version as often as the attribute `reload` says, until the player has another source, loads again or is
 * not in a page any more. Recordings that grow are followed by the engine. Time, camera and picture stay.
 * @param {import('./element.js').L4DPlayer} player @param {string} url
 */
export const watchFile = async (player, url) => {
  const seconds = Math.max(leastSeconds, Number(player.getAttribute('reload')) || usualSeconds);
  const own = player.watching = {};
  let known = await versionOf(url);
  for (;;) {
    await new Promise(resolve => setTimeout(resolve, 1000 * seconds));
    if (player.watching !== own || player.source !== url || !player.life) return;
    if (document.hidden || player.movie?.live || !player.isOpen && !player.error) continue;
    const version = await versionOf(url);
    if (player.watching !== own || player.source !== url || !version) continue;
    if (known && version !== known) {
      await player.sleep();
      if (player.source === url && player.life) await player.load(url).catch(() => {});  // which shows why
      return;
    }
    known = version;
  }
};
