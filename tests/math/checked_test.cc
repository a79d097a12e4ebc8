// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/base/checked.h"

#include <gtest/gtest.h>

namespace l4d {
namespace {

TEST(Checked, Add) {
  uint64_t out = 7;
  EXPECT_TRUE(checked_add(2, 3, &out));
  EXPECT_EQ(out, 5u);
  EXPECT_TRUE(checked_add(UINT64_MAX, 0, &out));
  EXPECT_EQ(out, UINT64_MAX);
  EXPECT_TRUE(checked_add(UINT64_MAX - 9, 9, &out));
  EXPECT_EQ(out, UINT64_MAX);
  out = 7;
  EXPECT_FALSE(checked_add(UINT64_MAX, 1, &out));
  EXPECT_FALSE(checked_add(1, UINT64_MAX, &out));
  EXPECT_EQ(out, 7u);
}

TEST(Checked, AlignUp) {
  EXPECT_EQ(align_up(0, 8), 0u);
  EXPECT_EQ(align_up(1, 8), 8u);
  EXPECT_EQ(align_up(8, 8), 8u);
  EXPECT_EQ(align_up(9, 1), 9u);
  EXPECT_EQ(align_up(4097, 4096), 8192u);
  EXPECT_EQ(align_up(UINT64_MAX - 15, 16), UINT64_MAX - 15);
}

}  // namespace
}  // namespace l4d
