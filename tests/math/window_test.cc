// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/scene/window.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "tests/math/reference.h"

namespace l4d {
namespace {

using reference::Random;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

struct Rate {
  uint32_t num, den;
};
constexpr Rate kRates[] = {
    {30, 1},        {30000, 1001},   {24, 1},         {240, 1},
    {7, 3},         {1, 0xfffffffb}, {0xffffffff, 1}, {0xffffffff, 0xfffffffb},
    {3, 0xffffffff}};
constexpr uint32_t kFrames[] = {1, 2, 3, 7, 30, 32, 300, 65537, (1u << 24) - 1, 1u << 24};
constexpr double kBegins[] = {0.0, -2.5, 12.34, 1.7e9};

std::vector<l4d_timeline> timelines() {
  std::vector<l4d_timeline> out;
  for (const Rate& rate : kRates) {
    for (const uint32_t frames : kFrames) {
      for (const double begin : kBegins) {
        const l4d_timeline t{begin, frames, rate.num, rate.den, 0};
        if (tells_frames_apart(t)) out.push_back(t);
      }
    }
  }
  return out;
}

// As a player computes it.
double player_time(const l4d_timeline& t, double frame) {
  return t.time_begin + frame * static_cast<double>(t.fps_den) / static_cast<double>(t.fps_num);
}

// In the order of the sequence, the ends among them.
std::vector<uint32_t> some_frames(const l4d_timeline& t, Random& random) {
  std::vector<uint32_t> frames = {0, t.num_frames / 2, t.num_frames - 1};
  for (int i = 0; i < 20; ++i) {
    frames.push_back(static_cast<uint32_t>(random.uniform(0, t.num_frames - 0.5)));
  }
  std::sort(frames.begin(), frames.end());
  frames.erase(std::unique(frames.begin(), frames.end()), frames.end());
  return frames;
}

TEST(Window, TimesOfFramesAreInThem) {
  Random random(1);
  size_t checked = 0;
  for (const l4d_timeline& t : timelines()) {
    for (const uint32_t k : some_frames(t, random)) {
      ASSERT_EQ(frame_of_time(t, player_time(t, k)), k)
          << t.num_frames << " at " << t.fps_num << "/" << t.fps_den;
      // Up to the slack before the frame it is not yet there, and in its middle it is.
      ASSERT_EQ(frame_of_time(t, player_time(t, k + 0.5)), k);
      if (k > 0) {
        ASSERT_EQ(frame_of_time(t, player_time(t, k - 0.001)), k - 1);
      }
      ++checked;
    }
    EXPECT_EQ(frame_of_time(t, player_time(t, t.num_frames)), t.num_frames - 1);
    EXPECT_EQ(frame_of_time(t, kInfinity), t.num_frames - 1);
    EXPECT_EQ(frame_of_time(t, -kInfinity), 0u);
    EXPECT_EQ(frame_of_time(t, std::nan("")), 0u);
  }
  EXPECT_GT(checked, 3000u);
}

// spec: LAYR-2
TEST(Window, WindowsTileTime) {
  Random random(2);
  for (const l4d_timeline& t : timelines()) {
    std::vector<uint32_t> cuts = some_frames(t, random);
    cuts.push_back(t.num_frames);
    std::vector<double> times = {-kInfinity, kInfinity};
    for (const uint32_t k : cuts) {
      const double at = player_time(t, k);
      for (const double near : {at, std::nextafter(at, -kInfinity), std::nextafter(at, kInfinity),
                                player_time(t, k - kFrameSlack), player_time(t, k - 0.3)}) {
        times.push_back(near);
      }
    }
    std::sort(times.begin(), times.end());
    uint32_t before = 0;
    for (const double time : times) {
      const uint32_t frame = frame_of_time(t, time);
      EXPECT_GE(frame, before);
      before = frame;
      int open = 0;
      for (size_t i = 0; i + 1 < cuts.size(); ++i) {
        open += FrameWindow{cuts[i], cuts[i + 1]}.holds(frame);
      }
      ASSERT_EQ(open, 1) << time;
    }
  }
}

// spec: LAYR-3, LAYR-2
TEST(Window, BucketsOfAQueryHoldWhatIsVisible) {
  Random random(3);
  size_t placed = 0;
  for (const l4d_timeline& t : timelines()) {
    const uint32_t layers = num_layers(t.num_frames);
    for (const uint32_t begin : some_frames(t, random)) {
      const double share = random.uniform();
      const uint32_t rest = t.num_frames - begin;
      const FrameWindow window = {
          begin, begin + std::max(1u, static_cast<uint32_t>(rest * share * share * share * share))};
      const uint32_t finest = layer_of_window(window, t.num_frames, layers);
      // What fits a bucket fits one of every coarser layer.
      for (uint32_t layer = 0; layer <= finest; ++layer) {
        const uint32_t bucket = bucket_of_window(window, layer, t.num_frames);
        ASSERT_TRUE(window_fits(window, bucket, layer, t.num_frames));
        ASSERT_LE(window_base(bucket, layer, t.num_frames), window.begin);
        for (const double frame : {window.begin - 0.0006, window.begin - 0.0004, window.begin + 0.0,
                                   0.5 * (window.begin + window.end), window.end - 0.0006}) {
          const double time = player_time(t, frame);
          if (!window.holds(frame_of_time(t, time))) continue;
          const uint32_t near = bucket_of_time(t, time, layer);
          ASSERT_TRUE(same_or_neighbour(near, bucket)) << frame << " of layer " << layer;
          ++placed;
        }
      }
    }
  }
  EXPECT_GT(placed, 20000u);
}

TEST(Window, LayersFollowTheExtent) {
  // Of 2^j frames, single ones are alone in the finest layer: a bucket is half a frame there.
  for (const uint32_t frame : {0u, 11u, 31u}) {
    EXPECT_EQ(layer_of_window({frame, frame + 1}, 32, num_layers(32)), 5u);
    EXPECT_EQ(bucket_of_window({frame, frame + 1}, 5, 32), 2 * frame);
  }
  EXPECT_EQ(layer_of_window({0, 32}, 32, num_layers(32)), 0u);
  EXPECT_EQ(layer_of_window({0, 16}, 32, num_layers(32)), 1u);
  EXPECT_EQ(layer_of_window({8, 24}, 32, num_layers(32)), 1u);
  EXPECT_EQ(layer_of_window({3, 29}, 32, num_layers(32)), 0u);
  EXPECT_EQ(layer_of_window({0, 1}, 1, num_layers(1)), 0u);
  EXPECT_FALSE(window_fits({1, 2}, 0, 4, 16));
  // Over three buckets of two frames, a window is in the middle one.
  EXPECT_EQ(bucket_of_window({3, 7}, 3, 32), 2u);
  EXPECT_TRUE(window_fits({3, 7}, 2, 3, 32));
  EXPECT_GE(layer_of_window({3, 7}, 32, num_layers(32)), 3u);
}

TEST(Window, TheMiddleIsTheMeanTime) {
  const l4d_timeline t{10.0, 100, 25, 1, 0};
  EXPECT_EQ(window_middle(t, {0, 1}), 10.02);
  EXPECT_EQ(window_middle(t, {50, 100}), 13.0);
  const Sequence times = window_times(t, {25, 50});
  EXPECT_LT(times.begin, 11.0);
  EXPECT_GT(times.begin, 10.9999);
  EXPECT_EQ(times.end, 12.0);
  EXPECT_EQ(window_times(t, {0, 1}).begin, 10.0);
}

TEST(Window, ClocksThatDoNotTellFramesApart) {
  EXPECT_TRUE(tells_frames_apart({1.7e9, 1000, 240, 1, 0}));
  EXPECT_FALSE(tells_frames_apart({0x1p36, 1000, 30, 1, 0}));
  EXPECT_FALSE(tells_frames_apart({-0x1p36, 1000, 30, 1, 0}));
  EXPECT_TRUE(tells_frames_apart({0, 1u << 24, 0xffffffff, 1, 0}));
}

TEST(Window, WhatIsValid) {
  EXPECT_TRUE((FrameWindow{0, 1}).is_valid(1));
  EXPECT_FALSE((FrameWindow{0, 2}).is_valid(1));
  EXPECT_FALSE((FrameWindow{1, 1}).is_valid(4));
  EXPECT_FALSE((FrameWindow{2, 1}).is_valid(4));
  EXPECT_FALSE((FrameWindow{}).is_flat());
}

}  // namespace
}  // namespace l4d
