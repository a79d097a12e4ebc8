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

TEST(Settings, DevicesAreAListOfNumbers) {
  EXPECT_TRUE(devices_of("").empty());
  EXPECT_EQ(devices_of("0"), std::vector<uint32_t>({0}));
  EXPECT_EQ(devices_of("3,0,3"), std::vector<uint32_t>({3, 0, 3}));
  EXPECT_EQ(devices_of("0,1,2,3,4,5,6,7").size(), 8U);
  for (const char* wrong : {",", "0,", ",0", "0,,1", "-1", "a", "0;1", "0 1", "1000", "1e0",
                            "0,1,2,3,4,5,6,7,8", "99999999999999999999"}) {
    EXPECT_THROW(devices_of(wrong), io::Error) << wrong;
  }
  Settings s;
  s.backend = "cpu";
  EXPECT_NO_THROW(check(s));
  s.devices = "0";
  EXPECT_THROW(check(s), io::Error);
}

// Other devices may go on with a training, but not more or fewer of them. A training of before has
// one.
TEST(Settings, TheNumberOfDevicesStays) {
  Settings s;
  const std::string old = "devices ";
  std::string before = text_of(s);
  before.erase(before.find(old), old.size() + 1);
  EXPECT_EQ(differences(before, s, false), "");
  s.devices = "2";
  EXPECT_EQ(differences(before, s, false), "");
  s.devices = "0,1";
  EXPECT_NE(differences(before, s, false), "");
  before = text_of(s);
  s.devices = "5,2";
  EXPECT_EQ(differences(before, s, false), "");
  s.devices = "0,1,2";
  EXPECT_EQ(differences(before, s, false),
            "it has \"devices 0,1\", and now it is \"devices 0,1,2\"");
}

}  // namespace
}  // namespace l4d::train
