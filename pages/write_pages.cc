// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <exception>
#include <fstream>
#include <stdexcept>

#include "pages/manual.h"

namespace l4d::pages {
namespace {

void write(const std::string& path, const std::string& text) {
  std::ofstream file(path, std::ios::binary);
  file << text;
  file.close();
  if (!file) throw std::runtime_error(path + ": cannot be written");
}

}  // namespace

int write_pages(const Manual& manual, int argc, char** argv) {
  try {
    if (argc != 7) throw std::runtime_error("the arguments are VERSION DATE MAN BASH ZSH FISH");
    write(argv[3], man_page(manual, argv[1], argv[2]));
    write(argv[4], bash_completion(manual));
    write(argv[5], zsh_completion(manual));
    write(argv[6], fish_completion(manual));
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s: %s\n", argv[0], error.what());
    return 1;
  }
}

}  // namespace l4d::pages
