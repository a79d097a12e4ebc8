// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cstdlib>
#include <cstring>

#include "tests/playback/seeds.h"

namespace l4d::playback::test {

Seeds& seeds() {
  static Seeds seeds;
  return seeds;
}

}  // namespace l4d::playback::test

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  for (int i = 1; i < argc; ++i) {
    if (std::strncmp(argv[i], "--seeds=", 8) != 0) return 2;
    char* end = nullptr;
    l4d::playback::test::Seeds& s = l4d::playback::test::seeds();
    s.first = s.last = std::strtoull(argv[i] + 8, &end, 10);
    if (*end == ':') s.last = std::strtoull(end + 1, &end, 10);
    s.goes_on = s.last > s.first;
    if (*end != 0 || s.last < s.first) return 2;
  }
  return RUN_ALL_TESTS();
}
