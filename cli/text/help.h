// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace l4d::cli {

// `text` in lines of at most 100 columns that begin at column `indent`; the first is not indented.
std::string wrap(const std::string& text, size_t indent);

// Help pages: descriptions wrapped to 100 columns, choices named by the descriptions and not once
// more by the option.
class HelpFormatter : public CLI::Formatter {
 public:
  HelpFormatter();
  std::string make_option_opts(const CLI::Option* option) const override;
  std::string make_option_desc(const CLI::Option* option) const override;
  std::string make_help(const CLI::App* app, std::string name,
                        CLI::AppFormatMode mode) const override;
};

}  // namespace l4d::cli
