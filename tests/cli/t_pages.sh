# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# The man page and the completions know every command, option and choice of the tool, and bash
# offers them.

[ -d "$PAGES" ] || skip "no pages: this build cannot run the program that makes them"
man=$PAGES/man/man1/l4dcodec.1
bash=$PAGES/bash-completion/completions/l4dcodec
zsh=$PAGES/zsh/site-functions/_l4dcodec
fish=$PAGES/fish/vendor_completions.d/l4dcodec.fish

mapfile -t verbs < <(l4d --help | sed -n '/^Commands:/,/^$/s/^  \([a-z]*\) .*/\1/p')
[ "${#verbs[@]}" -ge 10 ] || die "commands: ${verbs[*]}"

# options_of VERB: names of all options that help lists, a line for each.
options_of() {
  l4d "$1" --help | sed -nE 's/^  (-[^ ]*).*/\1/p' | tr ',' '\n'
}

# complete WORD...: what bash offers for the last word, as readline would ask: a line for each.
complete_words() {
  (
    # shellcheck disable=SC1090
    . "$bash"
    # shellcheck disable=SC2034  # the function reads them
    COMP_WORDS=(l4dcodec "$@") COMP_CWORD=$#
    _l4dcodec
    [ "${#COMPREPLY[@]}" -eq 0 ] || printf '%s\n' "${COMPREPLY[@]}"
  )
}

# expect_words LIST WORD...: bash offers exactly these, in any order.
expect_words() {
  local want=$1
  shift
  expect_equal "$(complete_words "$@" | LC_ALL=C sort | paste -s -d ' ')" \
    "$(tr ' ' '\n' <<< "$want" | LC_ALL=C sort | paste -s -d ' ')"
}

# ---- the man page --------------------------------------------------------------------------------

# Plain text of the page's part between two headings of the first or second kind.
section_of() {
  awk -v heading="$1" '/^\.S[HS] / { on = ($0 == heading) } on' "$man" |
    sed -e 's/\\f[BIR]//g' -e 's/\\-/-/g' -e 's/\\e/\\/g'
}
for name in NAME SYNOPSIS DESCRIPTION COMMANDS 'COMMON OPTIONS' 'EXIT STATUS' EXAMPLES 'SEE ALSO'; do
  [ -n "$(section_of ".SH $name")" ] || die "the man page has no section $name"
done
expect_equal "$(section_of '.SH NAME' | tail -n +2)" \
  "l4dcodec - $(l4d --help | head -1)"
for status in 0 1 2 3 4 5 6 7 130; do
  section_of '.SH EXIT STATUS' | grep -qx "$status" || die "exit status $status is not explained"
done
expect_equal "$(section_of '.SH EXIT STATUS' | grep -cx '\.TP')" 9
# Every command of the examples is one that the tool would take.
section_of '.SH EXAMPLES' | grep '^l4dcodec ' > examples
[ "$(wc -l < examples)" -ge 10 ] || die "the man page has hardly an example"

# Every example of the help is in the page.
for verb in "${verbs[@]}"; do
  { section_of ".SS l4dcodec $verb" && section_of '.SH COMMON OPTIONS'; } > section
  grep -q '^\.SS ' section || die "the man page has no section on $verb"
  for option in $(options_of "$verb"); do
    grep -qE -- "^(.*, )?$option(,| |\$)" section || die "man page, $verb: no $option"
  done
  while read -r example; do
    grep -qxF -- "$example" examples || die "man page: no example $example"
  done < <(l4d "$verb" --help | sed -n 's/^  \(l4dcodec .*\)/\1/p')
done
section_of '.SS l4dcodec encode' > section
grep -qx 'paper-small' section || die "man page: no preset paper-small"
grep -A 1 -x 'codebook-size' section | grep -qF '(1..65536, by component, default 1024)' || die "man page: no parameter codebook-size"

# ---- bash ----------------------------------------------------------------------------------------

bash -n "$bash"
expect_words "${verbs[*]} help" ''
expect_words 'encode' enc
expect_words '--help --version' --
expect_words 'validate version view' help v
for verb in "${verbs[@]}"; do
  expect_words "$(options_of "$verb" | paste -s -d ' ')" "$verb" -
done
expect_words '--presentation' encode --presen
expect_words 'tiny' encode --preset ti
expect_words "$(l4d encode --help | sed -n '/^Presets:/,/^$/s/^  \([a-z][a-z-]*\) .*/\1/p' | paste -s -d ' ')" \
  encode --preset ''
expect_words 'never auto always' encode scene.ply --rcq ''
expect_words 'indexed main lossless' validate --profile ''
expect_words 'phone headset laptop desktop workstation studio' validate --level ''
# With an '=' between name and value, which most set-ups take for a word.
expect_words 'base' info --detail = b
expect_words 'full base' info --detail =
# Files: arguments, and values of options that are files.
touch 'one scene.ply' two.l4d
mkdir three
expect_equal "$(complete_words encode on)" 'one scene.ply'
expect_equal "$(complete_words encode two.l4d -o on)" 'one scene.ply'
expect_equal "$(complete_words encode --weights = on)" 'one scene.ply'
expect_equal "$(complete_words compare two.l4d --side-by-side tw)" 'two.l4d'
expect_equal "$(complete_words info '' | LC_ALL=C sort | grep -cxE 'one scene.ply|two.l4d|three')" 3
touch ./-odd.ply
expect_equal "$(complete_words info -- -o)" '-odd.ply'
# Nothing where there is nothing to tell.
expect_words '' encode --seed ''
expect_words '' encode --metadata t
expect_words '' version t
expect_words '' synth t
expect_words '' frobnicate --pre

# ---- zsh and fish ---------------------------------------------------------------------------------

# Each option of each command, in the part on that command.
for verb in "${verbs[@]}"; do
  awk -v label="    $verb)" '$0 == label { on = 1 } on; /;;/ { on = 0 }' "$zsh" > section
  for option in $(options_of "$verb"); do
    grep -qE -- "[')*]${option}[+=]?\\[" section || die "zsh, $verb: no $option"
  done
  awk -v verb="$verb" 'index($0, "__fish_seen_subcommand_from " verb "\x27")' "$fish" > section
  for option in $(options_of "$verb"); do
    case $option in
      --*) pattern=" -l ${option#--}( |\$)" ;;
      *) pattern=" -s ${option#-}( |\$)" ;;
    esac
    grep -qE -- "$pattern" section || die "fish, $verb: no $option"
  done
done

# ---- the trainer ----------------------------------------------------------------------------------

# The same program makes its pages: here, that it knows the command line.
trainer=$(dirname "$L4DCODEC")/l4dtrain
if [ ! -x "$trainer" ]; then
  echo "no l4dtrain in this build: its pages are not looked at"
  exit 0
fi
man=$PAGES/man/man1/l4dtrain.1
bash=$PAGES/bash-completion/completions/l4dtrain
# shellcheck disable=SC1090
. "$bash"
for verb in train eval inspect capture; do
  { section_of ".SS l4dtrain $verb" && section_of '.SH COMMON OPTIONS'; } > section
  # shellcheck disable=SC2034  # the function reads them
  COMP_WORDS=(l4dtrain "$verb" -) COMP_CWORD=2
  _l4dtrain
  printf '%s\n' "${COMPREPLY[@]}" > offered
  "$trainer" "$verb" --help | sed -nE 's/^  (-[^ ]*).*/\1/p' | tr ',' '\n' > options
  grep -qx -- --json options || die "l4dtrain $verb --help names no --json"
  while read -r option; do
    grep -qE -- "^(.*, )?$option(,| |\$)" section || die "man page, l4dtrain $verb: no $option"
    grep -qx -- "$option" offered || die "bash, l4dtrain $verb: no $option"
  done < options
done
expect_equal "$("$trainer" --version)" "l4dtrain $(l4d version --json | sed -n 's/.*"version": *"\([^"]*\)".*/\1/p' | head -1)"
expect_equal "$("$trainer" help eval)" "$("$trainer" eval --help)"
