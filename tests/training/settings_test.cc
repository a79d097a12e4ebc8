// SPDX-License-Identifier: Apache-2.0
#include "training/run/settings.h"

#include <gtest/gtest.h>

#include "training/run/report.h"

namespace l4d::train {
namespace {

// Files of earlier and later versions: what they lack has a default, what is not known is ignored.
TEST(Settings, OfOtherVersionsAreRead) {
  const Settings s = settings_of(R"({"capture": "c", "scale": 0.5, "seed": 7, "colour": "blue"})");
  EXPECT_EQ(s.capture, "c");
  EXPECT_EQ(s.scale, 0.5);
  EXPECT_EQ(s.seed, 7U);
  EXPECT_EQ(s.near, 0);
  EXPECT_EQ(s.density, "relocate");
  EXPECT_EQ(s.density_every, 1U);
  EXPECT_THROW(settings_of("{}"), io::Error);
  EXPECT_THROW(settings_of(R"({"capture": "c", "scale": "half"})"), io::Error);
  EXPECT_THROW(settings_of("no json"), io::Error);
  Settings all;
  all.capture = "x";
  all.near = 0.25;
  all.codec = "settle";
  all.preset = "tiny";
  EXPECT_EQ(text_of(settings_of(json_of(all))), text_of(all));
}

}  // namespace
}  // namespace l4d::train
