// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cctype>

#include "pages/manual.h"

namespace l4d::pages {
namespace {

// Text of a page: nothing in it is a request or an escape. A '-' of a command is one to copy, so
// every one is.
std::string escape(const std::string& text) {
  std::string result;
  for (const char c : text) {
    if (c == '\\') {
      result += "\\e";
    } else if (c == '-') {
      result += "\\-";
    } else if ((c == '.' || c == '\'') && (result.empty() || result.back() == '\n')) {
      result += std::string("\\&") + c;
    } else {
      result += c;
    }
  }
  return result;
}

std::string line(const std::string& text) { return escape(text) + "\n"; }

std::string bold(const std::string& text) { return "\\fB" + escape(text) + "\\fR"; }

std::string italic(const std::string& text) { return "\\fI" + escape(text) + "\\fR"; }

std::string upper(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  return text;
}

std::string entry(const ManualOption& option) {
  std::string head;
  for (const std::string& name : option.names()) head += (head.empty() ? "" : ", ") + bold(name);
  if (!option.value.empty()) head += " " + italic(option.value);
  std::string text = option.description;
  if (!option.default_value.empty()) text += " (default: " + option.default_value + ")";
  return ".TP\n" + head + "\n" + line(text);
}

std::string synopsis(const Manual& manual, const ManualVerb& verb) {
  std::string text = bold(manual.name) + " " + bold(verb.name) + " [" + italic("option") + " ...]";
  for (const auto& [name, description] : verb.positionals) text += " " + italic(name);
  return text + "\n";
}

bool heads_examples(const ManualText& note) {
  return note.text == "Examples:" || note.text == "Example:";
}

std::string section_of(const Manual& manual, const ManualVerb& verb) {
  std::string text = ".SS " + escape(manual.name + " " + verb.name) + "\n";
  text += line(verb.description + ".");
  for (const auto& [name, description] : verb.positionals) {
    text += ".TP\n" + italic(name) + "\n" + line(description);
  }
  for (const ManualGroup& group : verb.groups) {
    if (!group.title.empty()) text += ".PP\n" + bold(group.title + ":") + "\n";
    for (const ManualOption& option : group.options) text += entry(option);
  }
  for (const ManualText& note : verb.notes) {
    if (note.kind == ManualText::kEntry) {
      text += ".TP\n" + bold(note.head) + "\n" + line(note.text);
    } else if (note.kind == ManualText::kParagraph && !heads_examples(note)) {
      text += ".PP\n" + line(note.text);
    }
  }
  return text;
}

std::string examples(const Manual& manual) {
  std::string text;
  for (const ManualVerb& verb : manual.verbs) {
    std::string commands;
    for (const ManualText& note : verb.notes) {
      if (note.kind == ManualText::kExample) commands += line(note.text);
    }
    if (commands.empty()) continue;
    text += (text.empty() ? "" : ".PP\n") + line(verb.description + ":");
    text += ".PP\n.nf\n.RS\n" + commands + ".RE\n.fi\n";
  }
  return text;
}

}  // namespace

std::string man_page(const Manual& manual, const std::string& version, const std::string& date) {
  std::string text = ".\\\" Made from the command line of the tool when it was built.\n";
  text += ".TH " + upper(manual.name) + " 1 \"" + date + "\" \"" + manual.name + " " + version +
          "\" \"User Commands\"\n";
  text += ".SH NAME\n" + escape(manual.name) + " \\- " + line(manual.description);
  text += ".SH SYNOPSIS\n.nf\n";
  for (const ManualVerb& verb : manual.verbs) text += synopsis(manual, verb);
  text += bold(manual.name) + " " + bold("help") + " [" + italic("command") + "]\n.fi\n";
  text += ".SH DESCRIPTION\n";
  for (const std::string& paragraph : manual.overview) {
    if (&paragraph != &manual.overview[0]) text += ".PP\n";
    text += line(paragraph);
  }
  text += ".SH COMMANDS\n";
  for (const ManualVerb& verb : manual.verbs) text += section_of(manual, verb);
  text += ".SH COMMON OPTIONS\nEvery command takes these:\n";
  for (const ManualOption& option : manual.common) text += entry(option);
  text += ".SH EXIT STATUS\n";
  for (const auto& [code, meaning] : manual.exit_statuses) {
    text += ".TP\n" + bold(std::to_string(code)) + "\n" + line(meaning);
  }
  text += ".SH EXAMPLES\n" + examples(manual);
  return text + ".SH SEE ALSO\n" + manual.see_also;
}

}  // namespace l4d::pages
