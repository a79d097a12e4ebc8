// SPDX-License-Identifier: Apache-2.0
#include "pages/manual.h"

namespace l4d::pages {
namespace {

std::string join(const std::vector<std::string>& words, const std::string& between) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : between) + word;
  return text;
}

// The options of a verb and what may follow each of them.
std::string case_of(const Manual& manual, const ManualVerb& verb) {
  std::vector<std::string> all, files, others;
  std::string choices;
  for (const ManualOption& option : options_of(manual, verb)) {
    for (const std::string& name : option.names()) {
      all.push_back(name);
      if (option.takes_file()) {
        files.push_back(name);
      } else if (option.choices.empty() && !option.value.empty()) {
        others.push_back(name);
      }
    }
    if (option.choices.empty()) continue;
    choices += "        " + join(option.names(), " | ") + ") values='" + join(option.choices, " ") +
               "' ;;\n";
  }
  std::string text = "    " + verb.name + ")\n";
  text += "      options='" + join(all, " ") + "'\n";
  if (verb.positionals.empty()) text += "      files=''\n";
  text += "      case $option in\n" + choices;
  if (!files.empty()) text += "        " + join(files, " | ") + ") values=FILE ;;\n";
  if (!others.empty()) text += "        " + join(others, " | ") + ") values=OTHER ;;\n";
  return text + "      esac\n      ;;\n";
}

// What comes before and after the cases of verbs. `values` is what may follow the option before
// the cursor: FILE, OTHER (nothing to offer), words, or empty where that takes no value.
const char* const kBegin = R"(
  local current=${COMP_WORDS[COMP_CWORD]} option='' verb='' options='' values='' files=FILE word i
  COMPREPLY=()
  for ((i = 1; i < COMP_CWORD; i++)); do
    word=${COMP_WORDS[i]}
    if [[ $word != -* && ($verb == '' || $verb == help) ]]; then verb=$word; fi
    if [[ $word == -- ]]; then option=--; fi
  done
  # Of --name=value the shell makes three words, or one where '=' divides none.
  if [[ $option == -- ]]; then
    verb=${verb:-none}
  elif [[ $current == = ]]; then
    option=${COMP_WORDS[COMP_CWORD - 1]}
    current=''
  elif [[ ${COMP_WORDS[COMP_CWORD - 1]} == = ]]; then
    option=${COMP_WORDS[COMP_CWORD - 2]}
  else
    option=${COMP_WORDS[COMP_CWORD - 1]}
  fi
)";

const char* const kEnd = R"(  esac
  if [[ -z $values && $option != -- && $current == -* ]]; then
    values=$options
  elif [[ -z $values ]]; then
    values=$files
  fi
  case $values in
    '' | OTHER) ;;
    FILE)
      compopt -o filenames 2>/dev/null
      mapfile -t COMPREPLY < <(compgen -f -- "$current")
      ;;
    *) mapfile -t COMPREPLY < <(compgen -W "$values" -- "$current") ;;
  esac
}
)";

}  // namespace

std::string bash_completion(const Manual& manual) {
  std::vector<std::string> verbs;
  for (const ManualVerb& verb : manual.verbs) verbs.push_back(verb.name);
  const std::string function = "_" + manual.name;
  std::string text = "# shellcheck shell=bash\n# Completion of " + manual.name +
                     " in bash, made from its command line when it was built.\n";
  text += function + "() {" + kBegin;
  text += "  case $verb in\n";
  text += "    '') options='--help --version' files='" + join(verbs, " ") + " help' ;;\n";
  text += "    help) files='" + join(verbs, " ") + "' ;;\n";
  for (const ManualVerb& verb : manual.verbs) text += case_of(manual, verb);
  return text + kEnd + "complete -F " + function + " " + manual.name + "\n";
}

}  // namespace l4d::pages
