// SPDX-License-Identifier: Apache-2.0
#include "pages/manual.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <sstream>
#include <stdexcept>

namespace l4d::pages {
namespace {

std::vector<std::string> split(const std::string& text, char separator) {
  std::vector<std::string> parts;
  std::istringstream stream(text);
  for (std::string part; std::getline(stream, part, separator);) parts.push_back(part);
  return parts;
}

// Words with one space between them.
std::string squeeze(const std::string& text) {
  std::istringstream words(text);
  std::string result;
  for (std::string word; words >> word;) result += (result.empty() ? "" : " ") + word;
  return result;
}

ManualOption option_of(const CLI::Option& option) {
  ManualOption result;
  if (!option.get_snames().empty()) result.short_name = "-" + option.get_snames()[0];
  if (option.get_lnames().empty()) {
    throw std::logic_error(option.get_name() + " has no long name");
  }
  result.long_name = "--" + option.get_lnames()[0];
  result.description = squeeze(option.get_description());
  if (option.get_type_size() == 0) return result;
  // "NAME:{auto,cpu}": what validators say of themselves follows the name of the type.
  const std::string type = option.get_type_name();
  result.value = type.substr(0, type.find(':'));
  const size_t open = type.find(":{");
  const size_t close = type.find('}', open == std::string::npos ? 0 : open);
  if (open != std::string::npos && close != std::string::npos) {
    result.choices = split(type.substr(open + 2, close - open - 2), ',');
  }
  result.default_value = option.get_default_str();
  result.repeats = option.get_expected_max() > 1;
  return result;
}

// A footer, as HelpFormatter prints it: an indented line is a command, or begins an entry of a
// table, whose further lines are indented more. A heading is a paragraph of its own.
std::vector<ManualText> notes_of(const std::string& footer, const std::string& tool) {
  std::vector<ManualText> notes;
  bool open = false;  // whether a line without indent goes on with the last paragraph
  for (const std::string& line : split(footer, '\n')) {
    const size_t indent = line.find_first_not_of(' ');
    if (indent == std::string::npos) {
      open = false;
    } else if (indent == 0) {
      if (!open) notes.push_back({ManualText::kParagraph, "", ""});
      notes.back().text += (notes.back().text.empty() ? "" : " ") + squeeze(line);
      open = line.back() != ':';
    } else if (line.compare(indent, tool.size() + 1, tool + " ") == 0) {
      notes.push_back({ManualText::kExample, "", line.substr(indent)});
      open = false;
    } else if (indent > 2 && !notes.empty() && notes.back().kind == ManualText::kEntry) {
      notes.back().text += " " + squeeze(line);
    } else {
      const size_t gap = line.rfind("  ");
      const bool has_head = gap > indent;
      notes.push_back({ManualText::kEntry, has_head ? squeeze(line.substr(0, gap)) : squeeze(line),
                       has_head ? squeeze(line.substr(gap)) : ""});
      open = false;
    }
  }
  return notes;
}

// In the order of `verb`, options of one group together.
void add_option(const ManualOption& option, const std::string& title,
                std::vector<ManualGroup>* groups) {
  const auto same = [&](const ManualGroup& group) { return group.title == title; };
  auto group = std::find_if(groups->begin(), groups->end(), same);
  if (group == groups->end()) group = groups->insert(groups->end(), {title, {}});
  group->options.push_back(option);
}

// Whether every verb has this option: such options are listed once.
bool is_common(const CLI::App& app, const CLI::Option& option) {
  const auto verbs = app.get_subcommands(nullptr);
  return std::all_of(verbs.begin(), verbs.end(), [&](const CLI::App* verb) {
    const CLI::Option* same = verb->get_option_no_throw(option.get_name());
    return same != nullptr && same->get_description() == option.get_description();
  });
}

ManualVerb verb_of(const CLI::App& app, const CLI::App& verb) {
  ManualVerb result;
  result.name = verb.get_name();
  result.description = verb.get_description();
  for (const CLI::Option* option : verb.get_options()) {
    if (option->get_positional()) {
      result.positionals.emplace_back(option->get_name(true), squeeze(option->get_description()));
    } else if (!option->get_group().empty() && !is_common(app, *option)) {
      const std::string group = option->get_group();
      add_option(option_of(*option), group == "Options" ? "" : group, &result.groups);
    }
  }
  // A verb without a footer of its own shows that of the tool.
  if (verb.get_footer() != app.get_footer()) {
    result.notes = notes_of(verb.get_footer(), app.get_name());
  }
  return result;
}

}  // namespace

std::vector<std::string> ManualOption::names() const {
  if (short_name.empty()) return {long_name};
  return {short_name, long_name};
}

Manual manual_of(const CLI::App& app) {
  Manual manual;
  manual.name = app.get_name();
  manual.description = app.get_description();
  const auto verbs = app.get_subcommands(nullptr);
  for (const CLI::App* verb : verbs) manual.verbs.push_back(verb_of(app, *verb));
  for (const CLI::Option* option : verbs.at(0)->get_options()) {
    if (!option->get_positional() && is_common(app, *option)) {
      manual.common.push_back(option_of(*option));
    }
  }
  return manual;
}

std::vector<ManualOption> options_of(const Manual& manual, const ManualVerb& verb) {
  std::vector<ManualOption> options;
  for (const ManualGroup& group : verb.groups) {
    options.insert(options.end(), group.options.begin(), group.options.end());
  }
  options.insert(options.end(), manual.common.begin(), manual.common.end());
  return options;
}

std::string in_brief(const std::string& description) {
  constexpr size_t kLongest = 72;
  std::string text = description.substr(0, description.find("; "));
  text = text.substr(0, text.find(". "));
  if (text.size() <= kLongest) return text;
  return text.substr(0, text.rfind(' ', kLongest)) + " ..";
}

}  // namespace l4d::pages
