// SPDX-License-Identifier: Apache-2.0
#include "io/image/nal_scan.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

namespace l4d::io {
namespace {

using Bytes = std::vector<uint8_t>;

// Units behind their lengths.
Bytes stream(const std::vector<Bytes>& units) {
  Bytes out;
  for (const Bytes& unit : units) {
    out.insert(out.end(), {0, 0, 0, static_cast<uint8_t>(unit.size())});
    out.insert(out.end(), unit.begin(), unit.end());
  }
  return out;
}

// Whatever the pieces are in which the bytes come.
std::optional<uint64_t> damage(const Bytes& bytes) {
  std::optional<uint64_t> found;
  for (const size_t piece : {size_t{1}, size_t{3}, bytes.size()}) {
    NalScan scan;
    for (size_t at = 0; at < bytes.size(); at += piece) {
      scan.add(&bytes[at], std::min(piece, bytes.size() - at));
    }
    if (piece != 1) {
      EXPECT_EQ(scan.damaged_unit(), found) << piece;
    }
    found = scan.damaged_unit();
  }
  return found;
}

TEST(NalScan, FindsTheUnitThatIsWrong) {
  const Bytes good = {0x65, 1, 2, 0, 0, 3, 1, 0, 4};
  EXPECT_EQ(damage(stream({good, good, good})), std::nullopt);
  EXPECT_EQ(damage(stream({good, {0x41, 9, 0, 0, 0}})), std::nullopt);  // zeros at the end
  for (const Bytes& bad : {Bytes{0x41, 0, 0, 0, 7}, Bytes{0x41, 0, 0, 1, 7}, Bytes{0x41, 0, 0, 2},
                           Bytes{0x41, 0, 0, 0, 0, 0, 7}, Bytes{}}) {
    EXPECT_EQ(damage(stream({good, bad, good})), 4 + good.size());
  }
}

TEST(NalScan, FindsLengthsThatDoNotFit) {
  Bytes bytes = stream({{0x65, 1, 2}, {0x41, 5, 6, 7}});
  bytes.pop_back();
  EXPECT_EQ(damage(bytes), 7U);
  bytes.resize(9);
  EXPECT_EQ(damage(bytes), 7U);
  bytes.resize(7);
  EXPECT_EQ(damage(bytes), std::nullopt);
  EXPECT_EQ(damage({}), std::nullopt);
}

TEST(NalScan, LeavesStartCodesAlone) {
  EXPECT_EQ(damage({0, 0, 0, 1, 0x65, 1, 0, 0, 1, 0x41, 2}), std::nullopt);
  EXPECT_EQ(damage({0, 0, 1, 0x65, 1, 0, 0, 1, 0x41, 2}), std::nullopt);
}

}  // namespace
}  // namespace l4d::io
