// SPDX-License-Identifier: Apache-2.0
#include "cli/command/options.h"

#include <CLI/CLI.hpp>
#include <charconv>

namespace l4d::cli {

Option* Option::type_name(const std::string& name) {
  option_->type_name(name);
  return this;
}

Option* Option::group(const std::string& heading) {
  option_->group(heading);
  return this;
}

Option* Option::required() {
  option_->required();
  return this;
}

Option* Option::one_of(const std::vector<std::string>& values) {
  option_->check(CLI::IsMember(values));
  return this;
}

Option* Option::offers(const std::vector<std::string>& values) {
  // In the form in which CLI::IsMember tells its choices.
  option_->check(CLI::Validator([](std::string&) { return std::string(); },
                                "{" + CLI::detail::join(values, ",") + "}"));
  return this;
}

Option* Option::whole_number(uint64_t min, uint64_t max) {
  // An empty name, so that help does not repeat the range behind the type.
  option_->transform(CLI::Validator(
      [min, max](std::string& text) -> std::string {
        uint64_t value = 0;
        const char* end = text.data() + text.size();
        const auto result = std::from_chars(text.data(), end, value);
        if (result.ec == std::errc() && result.ptr == end && value >= min && value <= max) {
          text = std::to_string(value);  // "010" is ten
          return "";
        }
        const std::string range =
            max == UINT64_MAX ? (min == 0 ? "" : " from " + std::to_string(min) + " on")
                              : " from " + std::to_string(min) + " to " + std::to_string(max);
        return "'" + text + "' is not a whole number" + range;
      },
      ""));
  return this;
}

Option* Option::excludes(Option* other) {
  option_->excludes(other->option_);
  return this;
}

Option* Option::needs(Option* other) {
  option_->needs(other->option_);
  return this;
}

Option* Option::capture_default_str() {
  option_->capture_default_str();
  return this;
}

Option* Option::allow_extra_args(bool allow) {
  option_->allow_extra_args(allow);
  return this;
}

Option* Option::delimiter(char character) {
  option_->delimiter(character);
  return this;
}

Verb::Verb(CLI::App& tool, const std::string& name, const std::string& description)
    : app_(tool.add_subcommand(name, description)) {
  app_->group("Commands");
}

Option* Verb::keep(CLI::Option* option) { return &options_.emplace_back(option); }

Option* Verb::add_option(const std::string& names, std::string& value,
                         const std::string& description) {
  return keep(app_->add_option(names, value, description));
}

Option* Verb::add_option(const std::string& names, std::vector<std::string>& values,
                         const std::string& description) {
  return keep(app_->add_option(names, values, description));
}

Option* Verb::add_option(const std::string& names, uint32_t& value,
                         const std::string& description) {
  return keep(app_->add_option(names, value, description));
}

Option* Verb::add_option(const std::string& names, uint64_t& value,
                         const std::string& description) {
  return keep(app_->add_option(names, value, description));
}

Option* Verb::add_option(const std::string& names, int& value, const std::string& description) {
  return keep(app_->add_option(names, value, description));
}

Option* Verb::add_option(const std::string& names, double& value, const std::string& description) {
  return keep(app_->add_option(names, value, description));
}

Option* Verb::add_flag(const std::string& names, bool& value, const std::string& description) {
  return keep(app_->add_flag(names, value, description));
}

Option* Verb::get_option(const std::string& name) { return keep(app_->get_option(name)); }

void Verb::footer(const std::string& text) { app_->footer(text); }

void Verb::take_anything() { app_->allow_extras(); }

void Verb::when_chosen(std::function<void()> call) { app_->callback(std::move(call)); }

}  // namespace l4d::cli
