// SPDX-License-Identifier: Apache-2.0
#include "io/formats/raw_arrays.h"

#include <limits>

#include "io/formats/scene_file.h"
#include "tests/io/support.h"

namespace l4d::io {
namespace {

class RawArraysTest : public test::IoTest {
 protected:
  Scene back(const Scene& scene) {
    write_raw(path("a.safetensors"), scene);
    return read_scene_file(path("a.safetensors"), path("a.safetensors"));
  }
};

TEST_F(RawArraysTest, ASceneComesBackBitForBit) {
  for (const uint32_t degree : {0U, 3U}) {
    for (const uint32_t flags : {0U, uint32_t{L4D_POSITION_AT_MEAN_TIME | L4D_OPACITY_LOGIT}}) {
      Scene scene = test::random_scene(7, 33, degree);
      scene.flags = flags;
      if (flags == 0) {
        for (float& o : scene.opacity) o = 0.5F;
      }
      scene.placement.scale = 0.25;
      scene.rendering.dilation = 0.125F;
      const Scene same = back(scene);
      test::expect_same_arrays(scene, same);
      EXPECT_EQ(same.source, "raw");
      EXPECT_EQ(same.flags, flags);
      EXPECT_EQ(same.timeline.num_frames, scene.timeline.num_frames);
      EXPECT_EQ(same.timeline.time_begin, scene.timeline.time_begin);
      EXPECT_EQ(same.placement.scale, 0.25);
      EXPECT_EQ(same.rendering.dilation, 0.125F);
      EXPECT_TRUE(same.notes.empty());
      EXPECT_TRUE(same.window.empty() && same.mean_t_double.empty());
    }
  }
}

TEST_F(RawArraysTest, TimesAsDoubleAndWindowsAreKept) {
  Scene scene = test::random_scene(8, 5, 1);
  std::vector<double> times = {1e9 + 1.0 / 3, 1e9, 1e9 + 1, 1e9 + 2, 1e9 + 3};
  scene.set_mean_times(times);
  scene.timeline.time_begin = 1e9;
  scene.window = {0, 0, 3, 9, 0, 0, 1, 2, 0, 0};
  const Scene same = back(scene);
  EXPECT_EQ(same.mean_t_double, times);
  EXPECT_EQ(same.window, scene.window);
  test::expect_same_arrays(scene, same);
}

TEST_F(RawArraysTest, ArraysLieAlignedToTheirElements) {
  write_raw(path("a.safetensors"),
            {"packed",
             3,
             0,
             0,
             {0, 30, 30, 1, 0},
             {{0, 0, 0}, 1, 0, 0},
             default_rendering(),
             default_presentation()},
            {raw_array("bytes", {3}, std::vector<uint8_t>{1, 2, 3}),
             raw_array("words", {1, 3}, std::vector<uint16_t>{4, 5, 0x1234}),
             raw_array("doubles", {3}, std::vector<double>{0, 0, 1})});
  const std::string bytes = test::read_bytes(path("a.safetensors"));
  const size_t data =
      8 + static_cast<unsigned char>(bytes[0]) + 256 * size_t{static_cast<unsigned char>(bytes[1])};
  EXPECT_EQ(data % 8, 0U);
  // 24 bytes of doubles, then words, then bytes, the least significant first.
  EXPECT_EQ(bytes.substr(data + 24 - 2), std::string("\xf0\x3f\4\0\5\0\x34\x12\1\2\3", 11));
  EXPECT_NE(bytes.find(R"("dtype":"U16","shape":[1,3])"), std::string::npos);
}

TEST_F(RawArraysTest, WhatNoSceneMayHoldIsNotWritten) {
  Scene scene = test::random_scene(9, 4, 0);
  scene.position[7] = std::numeric_limits<float>::infinity();
  EXPECT_EQ(test::status_of([&] { write_raw(path("a.safetensors"), scene); }),
            L4D_ERR_INVALID_SCENE);
  EXPECT_EQ(files_in_directory(), 0U);
}

}  // namespace
}  // namespace l4d::io
