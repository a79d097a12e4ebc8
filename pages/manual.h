// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace CLI {
class App;
}

// What the man page and the completions of shells are made of: the command line of a tool as data.
// A tool has verbs, `help VERB` and --version.
namespace l4d::pages {

struct ManualOption {
  std::string short_name;            // "-o", or empty
  std::string long_name;             // "--output"
  std::string value;                 // what the help calls its value, "FILE"; empty for a flag
  std::string default_value;         // empty: none that the help tells
  std::string description;           // plain text, any length
  std::vector<std::string> choices;  // values, where there are only these
  bool repeats = false;

  bool takes_file() const { return value == "FILE" || value == "FOLDER"; }
  std::vector<std::string> names() const;
};

struct ManualGroup {
  std::string title;  // empty: options of the verb alone
  std::vector<ManualOption> options;
};

// What stands below the options of a verb: text in paragraphs, commands to type, tables of names.
struct ManualText {
  enum Kind { kParagraph, kExample, kEntry };
  Kind kind;
  std::string head;  // of an entry: its name
  std::string text;
};

struct ManualVerb {
  std::string name;
  std::string description;
  // Name and description. All are files.
  std::vector<std::pair<std::string, std::string>> positionals;
  std::vector<ManualGroup> groups;  // without those that all verbs have
  std::vector<ManualText> notes;
};

struct Manual {
  std::string name;
  std::string description;
  std::vector<ManualOption> common;  // options of every verb
  std::vector<ManualVerb> verbs;
  // What the caller knows: paragraphs on all verbs, and with each exit status what it means. What
  // else to read, as a request of roff.
  std::vector<std::string> overview;
  std::vector<std::pair<int, std::string>> exit_statuses;
  std::string see_also;
};

// `app`: with all of its verbs, none of them parsed. Without what the caller knows.
Manual manual_of(const CLI::App& app);

// All options that may follow a verb.
std::vector<ManualOption> options_of(const Manual& manual, const ManualVerb& verb);

// What fits beside an option in a list of completions: a first clause.
std::string in_brief(const std::string& description);

// Each is a whole file. date: "2026-01-31"; version: "0.1.0".
std::string man_page(const Manual& manual, const std::string& version, const std::string& date);
std::string bash_completion(const Manual& manual);
std::string zsh_completion(const Manual& manual);
std::string fish_completion(const Manual& manual);

// The rest of a program whose arguments are VERSION DATE MAN BASH ZSH FISH, the last four the files
// to write: its exit status.
int write_pages(const Manual& manual, int argc, char** argv);

}  // namespace l4d::pages
