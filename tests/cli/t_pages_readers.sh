# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# What else reads the pages takes them: man, mandoc, zsh and fish, where they are there.

[ -d "$PAGES" ] || skip "no pages: this build cannot run the program that makes them"
man=$PAGES/man/man1/l4dcodec.1
zsh=$PAGES/zsh/site-functions/_l4dcodec
fish=$PAGES/fish/vendor_completions.d/l4dcodec.fish
missing=''

if command -v mandoc > /dev/null; then
  mandoc -T lint -W warning "$PAGES"/man/man1/*.1 >&2 || die "mandoc complains"
else
  missing+=' mandoc'
fi
if command -v man > /dev/null; then
  MANWIDTH=80 LC_ALL=C.UTF-8 man --warnings=all -l "$man" > text 2> lint
  [ ! -s lint ] || die "man: $(cat lint)"
fi
# Where a small system has a notice in place of man, there is none.
if [ -e text ] && ! grep -q minimized text; then
  # A page that the system left out shows as a notice of a few lines.
  [ "$(wc -l < text)" -gt 300 ] || die "man shows $(wc -l < text) lines"
  grep -q '^EXIT STATUS' text || die "man shows no section EXIT STATUS"
else
  missing+=' man'
fi

if command -v zsh > /dev/null; then
  for file in "$PAGES"/zsh/site-functions/*; do zsh -f -n "$file"; done
  # The shell takes it for the completion of the tool.
  mkdir zsh
  cp "$zsh" zsh
  # shellcheck disable=SC2016  # for zsh
  expect_equal "$(HOME=$PWD zsh -f -c 'fpath=($PWD/zsh $fpath); autoload -Uz compinit
    compinit -u -D; print -r -- $_comps[l4dcodec]')" '_l4dcodec'
else
  missing+=' zsh'
fi

touch two.l4d
# fish_offers LINE: what fish offers for a line, without descriptions.
fish_offers() {
  HOME=$PWD fish --no-config -c "source '$fish'; complete -C '$1'" | cut -f 1 | LC_ALL=C sort | paste -s -d ' '
}
if command -v fish > /dev/null; then
  for file in "$PAGES"/fish/vendor_completions.d/*; do fish --no-execute "$file"; done
  expect_equal "$(fish_offers 'l4dcodec enc')" 'encode'
  expect_equal "$(fish_offers 'l4dcodec help va')" 'validate'
  expect_equal "$(fish_offers 'l4dcodec encode --presen')" '--presentation'
  expect_equal "$(fish_offers 'l4dcodec encode --rcq ')" 'always auto never'
  expect_equal "$(fish_offers 'l4dcodec encode -o tw')" 'two.l4d'
  expect_equal "$(fish_offers 'l4dcodec encode tw')" 'two.l4d'
  expect_equal "$(fish_offers 'l4dcodec encode --seed t')" ''
  expect_equal "$(fish_offers 'l4dcodec version tw')" ''
else
  missing+=' fish'
fi

[ -z "$missing" ] || skip "the rest passes, but there is no$missing"
