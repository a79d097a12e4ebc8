// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <string>
#include <vector>

// The parser of command lines, CLI11, takes seconds to compile wherever it is included: files that
// define options see it through this header only.
namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace l4d::cli {

// An option, flag or positional argument of a verb. Setters return the option itself.
class Option {
 public:
  explicit Option(CLI::Option* option) : option_(option) {}

  Option* type_name(const std::string& name);  // of the value, in help
  Option* group(const std::string& heading);   // of help, under which it is listed
  Option* required();
  Option* one_of(const std::vector<std::string>& values);
  // The values that completions offer. The verb may accept more, and reports errors itself.
  Option* offers(const std::vector<std::string>& values);
  // Decimal digits only, which the parser by itself does not ask for ("-1" is a large number to it,
  // "010" is 8).
  Option* whole_number(uint64_t min, uint64_t max = UINT64_MAX);
  Option* excludes(Option* other);
  Option* needs(Option* other);
  // Help shows the value that the variable has now.
  Option* capture_default_str();
  // Of options that may be repeated: each takes one value.
  Option* allow_extra_args(bool allow);
  Option* delimiter(char character);  // between several values

 private:
  CLI::Option* option_;
};

// A subcommand. Names are as "-o,--output", or "input" for a positional argument. The variables are
// written when the command line is parsed, and must live until then.
class Verb {
 public:
  // Adds the subcommand to the tool.
  Verb(CLI::App& tool, const std::string& name, const std::string& description);
  Verb(const Verb&) = delete;
  Verb& operator=(const Verb&) = delete;

  Option* add_option(const std::string& names, std::string& value, const std::string& description);
  Option* add_option(const std::string& names, std::vector<std::string>& values,
                     const std::string& description);
  Option* add_option(const std::string& names, uint32_t& value, const std::string& description);
  Option* add_option(const std::string& names, uint64_t& value, const std::string& description);
  Option* add_option(const std::string& names, int& value, const std::string& description);
  Option* add_option(const std::string& names, double& value, const std::string& description);
  Option* add_flag(const std::string& names, bool& value, const std::string& description);
  Option* get_option(const std::string& name);  // that was added before
  void footer(const std::string& text);         // of help
  void take_anything();  // arguments that are not defined, without a complaint
  // Called once the whole line is parsed, where it names this verb.
  void when_chosen(std::function<void()> call);

 private:
  Option* keep(CLI::Option* option);

  CLI::App* app_;
  std::deque<Option> options_;
};

}  // namespace l4d::cli
