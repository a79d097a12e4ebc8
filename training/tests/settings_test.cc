// SPDX-License-Identifier: Apache-2.0
#include "training/run/setup/settings.h"

#include <gtest/gtest.h>

#include "training/cli/pace.h"
#include "training/run/report/report.h"
#include "training/run/setup/memory.h"

namespace l4d::train {
namespace {

// Work of 1,000 parts, of which the second half takes four times as long.
TEST(Pace, FollowsWorkThatSlowsDown) {
  const auto time_of = [](uint64_t done) {
    const double d = static_cast<double>(done);
    return 100 + (d < 500 ? 0.01 * d : 5 + 0.04 * (d - 500));
  };
  Pace pace;
  pace.begin(time_of(0), 0);
  EXPECT_LT(pace.left(time_of(50), 50, 1000), 0) << "half a second tells nothing";
  const auto left_at = [&](uint64_t done) { return pace.left(time_of(done), done, 1000); };
  for (uint64_t done = 1; done <= 400; ++done) pace.note(time_of(done), done);
  EXPECT_NEAR(left_at(400), 6, 0.1);
  for (uint64_t done = 401; done <= 800; ++done) pace.note(time_of(done), done);
  EXPECT_NEAR(left_at(800), time_of(1000) - time_of(800), 0.5);
  EXPECT_EQ(left_at(1000), 0);

  // A run that resumes has parts that it has not done itself.
  pace.begin(7, 500);
  EXPECT_LT(pace.left(9, 500, 1000), 0);
  EXPECT_NEAR(pace.left(9, 600, 1000), 8, 1e-9);
}

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

// A training that an earlier version began goes on: what its checkpoint does not name has not
// changed, unless it is asked for now.
TEST(Settings, WhatACheckpointDoesNotNameIsTheDefault) {
  Settings s;
  s.near = 0;
  s.gaussians = s.resident = 1000;
  std::string before = text_of(s);
  for (const char* key : {"temporal_split", "size", "quality", "effort", "near", "resident",
                          "any_path", "device_memory", "devices"}) {
    const size_t at = before.find("\n" + std::string(key) + " ");
    ASSERT_NE(at, std::string::npos) << key;
    before.erase(at, before.find('\n', at + 1) - at);
    EXPECT_EQ(differences(before, s, false), "") << key;
  }
  const auto difference = [&](void (*change)(Settings * settings)) {
    Settings changed = s;
    change(&changed);
    return differences(before, changed, false);
  };
  EXPECT_EQ(difference([](Settings* now) { now->size = 5; }),
            "it has \"size 0\", and now it is \"size 5\"");
  EXPECT_EQ(difference([](Settings* now) { now->effort = "best"; }),
            "it has \"effort good\", and now it is \"effort best\"");
  EXPECT_NE(difference([](Settings* now) { now->near = 0.2; }), "");
  EXPECT_NE(difference([](Settings* now) { now->resident = 999; }), "");
}

// Images make way for the limit, down to what a training needs of them; nothing else does.
TEST(Memory, ImagesMakeWay) {
  MemoryNeed need;
  need.images = 800;
  need.least_images = 300;
  need.model = 500;
  need.rendering = 100;
  EXPECT_EQ(images_within(0, need, true), 800U);
  EXPECT_EQ(images_within(1400, need, false), 800U);
  EXPECT_EQ(images_within(1399, need, true), 799U);
  EXPECT_EQ(images_within(900, need, true), 300U);
  for (const bool may_shrink : {true, false}) {
    try {
      images_within(may_shrink ? 899 : 1399, need, may_shrink);
      ADD_FAILURE() << may_shrink;
    } catch (const io::Error& error) {
      EXPECT_EQ(error.status(), L4D_ERR_LIMIT_EXCEEDED);
    }
  }
}

// What rows of both images take, in the smallest network by hand: one convolution of 3 x 3.
TEST(Memory, CountsTheRowsOfLpips) {
  eval::LpipsNetwork network{"tiny", {{0, 3, 4, 3, 1, 1}}};
  eval::LpipsWeights weights{{std::vector<float>(108)}, {std::vector<float>(4)}, {{1, 1, 1, 1}}};
  const eval::Lpips lpips(network, weights);
  // Scaled rows; three lines of three channels, padded; the result; its columns; lengths.
  const uint64_t floats = 2 * 3 * 10 + 2 * (3 * 3 * 12 + 4 * 10 + 9 * 3 * 10) + 4 * 10;
  EXPECT_EQ(lpips.memory(10), 4 * floats);
}

}  // namespace
}  // namespace l4d::train
