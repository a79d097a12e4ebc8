// SPDX-License-Identifier: Apache-2.0
#include "pages/manual.h"

namespace l4d::pages {
namespace {

std::string quote(const std::string& text) {
  std::string result = "'";
  for (const char c : text) {
    if (c == '\'' || c == '\\') result += '\\';
    result += c;
  }
  return result + "'";
}

// " -s o -l output -r -F -d '..'"
std::string words_of(const ManualOption& option) {
  std::string text;
  if (!option.short_name.empty()) text += " -s " + option.short_name.substr(1);
  text += " -l " + option.long_name.substr(2);
  // -x: a value, and no file for it.
  if (!option.value.empty()) text += option.takes_file() ? " -r -F" : " -x";
  if (!option.choices.empty()) {
    std::string words;
    for (const std::string& choice : option.choices) words += (words.empty() ? "" : " ") + choice;
    text += " -a " + quote(words);
  }
  return text + " -d " + quote(in_brief(option.description)) + "\n";
}

}  // namespace

std::string fish_completion(const Manual& manual) {
  const std::string complete = "complete -c " + manual.name;
  std::string text = "# Completion of " + manual.name +
                     " in fish, made from its command line when it was built.\n";
  // Files are offered where a scene or a value is one, and nowhere else.
  text += complete + " -f\n";
  text += complete + " -n __fish_use_subcommand -s h -l help -d 'Print the commands'\n";
  text += complete + " -n __fish_use_subcommand -l version -d 'Print the versions'\n";
  text += complete + " -n __fish_use_subcommand -a help -d 'Print the options of a command'\n";
  for (const ManualVerb& verb : manual.verbs) {
    const std::string name = " -a " + verb.name + " -d " + quote(verb.description) + "\n";
    text += complete + " -n __fish_use_subcommand" + name;
    text += complete + " -n '__fish_seen_subcommand_from help'" + name;
    const std::string seen = complete + " -n '__fish_seen_subcommand_from " + verb.name + "'";
    if (!verb.positionals.empty()) text += seen + " -F\n";
    for (const ManualOption& option : options_of(manual, verb)) text += seen + words_of(option);
  }
  return text;
}

}  // namespace l4d::pages
