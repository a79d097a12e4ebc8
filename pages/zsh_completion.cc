// SPDX-License-Identifier: Apache-2.0
#include "pages/manual.h"

namespace l4d::pages {
namespace {

// Inside '..' of zsh and, there, inside [..] or between ':' of _arguments.
std::string zsh_escape(const std::string& text) {
  std::string result;
  for (const char c : text) {
    if (c == '\'') {
      result += "'\\''";
    } else {
      if (c == '[' || c == ']' || c == ':' || c == '\\') result += '\\';
      result += c;
    }
  }
  return result;
}

std::string message_and_action(const ManualOption& option) {
  if (option.value.empty()) return "";
  std::string action = " ";  // nothing to offer
  if (option.takes_file()) action = "_files";
  if (!option.choices.empty()) {
    action = "(";
    for (const std::string& choice : option.choices) {
      action += (action == "(" ? "" : " ") + zsh_escape(choice);
    }
    action += ")";
  }
  return ":" + zsh_escape(option.value) + ":" + action;
}

// "'(-o --output)-o+[Stream to write]:FILE:_files'", one word for each name: '+' is a value in the
// same word or the next, '=' one behind that sign or in the next.
std::string specs(const ManualOption& option) {
  std::string text;
  for (const std::string& name : option.names()) {
    std::string except;
    if (option.repeats) {
      except = "*";
    } else if (!option.short_name.empty()) {
      except = "(" + option.short_name + " " + option.long_name + ")";
    }
    std::string word = name;
    if (!option.value.empty()) word += name == option.short_name ? "+" : "=";
    text += "        '" + except + word + "[" + zsh_escape(in_brief(option.description)) + "]" +
            message_and_action(option) + "' \\\n";
  }
  return text;
}

std::string zsh_case(const Manual& manual, const ManualVerb& verb) {
  std::string text = "    " + verb.name + ")\n      _arguments -s -S \\\n";
  for (const ManualOption& option : options_of(manual, verb)) text += specs(option);
  for (const auto& [name, description] : verb.positionals) {
    text += "        ':" + zsh_escape(name) + ":_files' \\\n";
  }
  text.resize(text.size() - 3);  // the last word ends the command
  return text + "\n      ;;\n";
}

}  // namespace

std::string zsh_completion(const Manual& manual) {
  const std::string function = "_" + manual.name;
  std::string text = "#compdef " + manual.name + "\n# Completion of " + manual.name +
                     " in zsh, made from its command line when it was built.\n";
  text += function + "() {\n  local curcontext=$curcontext state line\n  local -A opt_args\n";
  text += "  local -a verbs=(\n";
  for (const ManualVerb& verb : manual.verbs) {
    text += "    '" + zsh_escape(verb.name) + ":" + zsh_escape(verb.description) + "'\n";
  }
  text += "    'help:Print the options of a command'\n  )\n";
  text +=
      "  _arguments -C '(- *)'{-h,--help}'[Print the commands]' "
      "'(- *)--version[Print the versions]' \\\n"
      "    '1:command:->verb' '*::argument:->arguments' && return\n"
      "  if [[ $state == verb ]]; then\n"
      "    _describe -t commands command verbs\n"
      "    return\n"
      "  fi\n"
      "  curcontext=\"${curcontext%:*}-$words[1]:\"\n"
      "  case $words[1] in\n"
      "    help) _describe -t commands command verbs ;;\n";
  for (const ManualVerb& verb : manual.verbs) text += zsh_case(manual, verb);
  return text + "  esac\n}\n" + function + " \"$@\"\n";
}

}  // namespace l4d::pages
