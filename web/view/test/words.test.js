// SPDX-License-Identifier: Apache-2.0
// The texts of the player in all languages.
import assert from 'node:assert/strict';
import {readFileSync} from 'node:fs';
import {test} from 'node:test';
import {addWords, Texts, words} from '../src/words.js';
import {spokenTime} from '../src/text.js';

const placeholders = (/** @type {string} */ text) => [...text.matchAll(/\{(\w+)\}/g)].map(([, name]) => name).sort().join();

test('each language has each word, with the same values in it', () => {
  assert.deepEqual(Object.keys(words), ['en', 'de', 'es', 'fr', 'ja', 'zh']);
  for (const [language, texts] of Object.entries(words)) {
    assert.deepEqual(Object.keys(texts).sort(), Object.keys(words.en).sort(), language);
    for (const [word, text] of Object.entries(words.en)) {
      assert.ok(texts[word].trim(), `${language}: ${word}`);
      assert.equal(placeholders(texts[word]), placeholders(text), `${language}: ${word}`);
    }
  }
});

test('the words of the template are there', () => {
  const template = readFileSync(new URL('../src/template.js', import.meta.url), 'utf8');
  const used = [...template.matchAll(/data-(?:text|label)="(\w+)"/g)].map(([, word]) => word);
  assert.ok(used.length > 20);
  assert.deepEqual(used.filter(word => !(word in words.en)), []);
});

test('numbers and durations are those of the language, and words that lack are English', () => {
  assert.equal(spokenTime(61, new Texts('en')), '1 minute 1 second');
  assert.deepEqual(['en', 'de', 'ja'].map(language => spokenTime(62.5, new Texts(language))),
                   ['1 minute 2.5 seconds', '1 Minute 2,5 Sekunden', '1 分 2.5 秒']);
  addWords({pl: {play: 'Odtwórz'}, DE: {play: 'Los'}});
  assert.deepEqual(['pl', 'de'].map(language => [new Texts(language).say('play'), new Texts(language).say('upTo', {level: 2})]),
                   [['Odtwórz', 'Up to level 2'], ['Los', 'Bis Ebene 2']]);
  assert.throws(() => addWords({'no language': {}}), RangeError);
});
