// SPDX-License-Identifier: Apache-2.0
#include "cli/command/help.h"

#include "cli/text/units.h"

namespace l4d::cli {
namespace {

constexpr size_t kIndent = 32;

}  // namespace

HelpFormatter::HelpFormatter() {
  column_width(kIndent);
  label("SUBCOMMAND", "COMMAND");
  label("Subcommands", "Commands");
}

std::string HelpFormatter::make_option_opts(const CLI::Option* option) const {
  if (option->get_positional() || option->get_type_size() == 0) return "";
  // What validators add to the type name follows a colon.
  const std::string type = option->get_type_name();
  std::string text = " " + type.substr(0, type.find(':'));
  if (!option->get_default_str().empty()) text += "=" + option->get_default_str();
  return text;
}

std::string HelpFormatter::make_option_desc(const CLI::Option* option) const {
  // The base class indents.
  return CLI::detail::find_and_replace(wrap(option->get_description(), kIndent),
                                       "\n" + std::string(kIndent, ' '), "\n");
}

// The default puts two empty lines between groups, and none that ends the last line.
std::string HelpFormatter::make_help(const CLI::App* app, std::string name,
                                     CLI::AppFormatMode mode) const {
  const std::string text = CLI::Formatter::make_help(app, std::move(name), mode);
  return CLI::detail::find_and_replace(text, "\n\n\n", "\n\n");
}

}  // namespace l4d::cli
