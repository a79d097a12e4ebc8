// SPDX-License-Identifier: Apache-2.0
// Runs the tests and writes what they observed to $L4D_NUMERICS_JSON. --full tries all inputs of 32
// bits, --names lists the formulas, --streams FOLDER writes the streams that compilers.sh decodes.
#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iostream>
#include <string>

#include "tests/common/codec.h"
#include "tests/numerics/formula.h"

namespace {

int write_streams(const std::string& folder) {
  using namespace l4d::test;
  const NamedFile kFiles[] = {
      {"staged", staged_file}, {"rcq", rcq_file}, {"lossless", lossless_file}};
  for (const NamedFile& f : kFiles) {
    const l4d::Bytes& bytes = f.bytes();
    std::ofstream file(folder + "/" + f.name + ".l4d", std::ios::binary);
    file.write(reinterpret_cast<const char*>(bytes.data()),
               static_cast<std::streamsize>(bytes.size()));
    file.close();
    if (file.fail()) {
      std::fprintf(stderr, "cannot write to %s\n", folder.c_str());
      return 1;
    }
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  for (int i = 1; i < argc; ++i) {
    if (std::strcmp(argv[i], "--full") == 0) {
      l4d::numerics::set_full(true);
    } else if (std::strcmp(argv[i], "--names") == 0) {
      for (const auto& f : l4d::numerics::formulas()) std::cout << f.name << "\n";
      return 0;
    } else if (std::strcmp(argv[i], "--streams") == 0 && i + 1 < argc) {
      return write_streams(argv[i + 1]);
    } else {
      std::fprintf(stderr, "unknown argument %s\n", argv[i]);
      return 2;
    }
  }
  // The same scenes in every run; what is set outside goes first.
  setenv("RC_PARAMS", "seed=2027 max_success=25", 0);
  int result = RUN_ALL_TESTS();
  const char* path = std::getenv("L4D_NUMERICS_JSON");
  if (path != nullptr && !l4d::numerics::write_results(path)) {
    std::fprintf(stderr, "cannot write %s\n", path);
    result = 1;
  }
  return result;
}
