// SPDX-License-Identifier: Apache-2.0
// usage: l4dcodec_pages VERSION DATE MAN BASH ZSH FISH
// Writes the man page and the completions to these files. A part of the build: it is not installed.
#include <cstdio>
#include <exception>
#include <fstream>
#include <stdexcept>
#include <string>

#include "cli/commands.h"
#include "cli/pages/manual.h"

namespace {

void write(const std::string& path, const std::string& text) {
  std::ofstream file(path, std::ios::binary);
  file << text;
  file.close();
  if (!file) throw std::runtime_error(path + ": cannot be written");
}

}  // namespace

int main(int argc, char** argv) {
  try {
    if (argc != 7) throw std::runtime_error("usage: l4dcodec_pages VERSION DATE MAN BASH ZSH FISH");
    const l4d::cli::CommandLine line;
    const l4d::cli::Manual manual = l4d::cli::manual_of(*line.app);
    write(argv[3], l4d::cli::man_page(manual, argv[1], argv[2]));
    write(argv[4], l4d::cli::bash_completion(manual));
    write(argv[5], l4d::cli::zsh_completion(manual));
    write(argv[6], l4d::cli::fish_completion(manual));
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "l4dcodec_pages: %s\n", error.what());
    return 1;
  }
}
