// SPDX-License-Identifier: Apache-2.0
#include "training/sync/sync.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>

#include "tests/common/ffmpeg.h"
#include "tests/common/files.h"
#include "training/sync/correlate.h"
#include "training/sync/motion.h"
#include "training/tests/tiny_capture.h"

namespace l4d::train {
namespace {

// What happened, as cameras see it: each with a gain, noise and a clock of its own.
std::vector<Signal> seen_by(const std::vector<double>& clocks, double rate, double noise) {
  std::mt19937 random(11);
  std::normal_distribution<double> normal;
  std::vector<double> times, strengths;
  for (double t = -10; t < 20 + *std::max_element(clocks.begin(), clocks.end());
       t += 0.1 + std::abs(normal(random)) * 0.4) {
    times.push_back(t);
    strengths.push_back(std::exp(normal(random)));
  }
  std::vector<Signal> signals;
  for (const double clock : clocks) {
    Signal signal;
    const double gain = std::exp(normal(random));
    for (int k = 0; k < 6 * rate; ++k) {
      double value = 0.3;
      for (size_t e = 0; e < times.size(); ++e) {
        const double distance = (k / rate + clock - times[e]) / 0.12;
        value += strengths[e] * std::exp(-distance * distance);
      }
      signal.push_back(gain * value * std::exp(noise * normal(random)));
    }
    signals.push_back(signal);
  }
  return signals;
}

TEST(Align, FindsClocks) {
  const std::vector<double> clocks = {0, 0, 0.5, -1.237, 0, 3.1, 0};
  const std::vector<Signal> signals = seen_by(clocks, 30, 0.2);
  const std::vector<Offset> found = align(signals, 30, 4, 1);
  for (size_t k = 0; k < clocks.size(); ++k) {
    EXPECT_TRUE(found[k].is_sure()) << k;
    EXPECT_NEAR(found[k].seconds, clocks[k], 0.02) << k;
  }
  const std::vector<Offset> again = align(signals, 30, 4, 3);
  for (size_t k = 0; k < clocks.size(); ++k) EXPECT_EQ(again[k].seconds, found[k].seconds);
}

// What tells nothing is not taken for something: a camera that sees other things, nothing at all,
// or for a moment; something that repeats; one camera alone.
TEST(Align, SaysWhereItDoesNotKnow) {
  std::vector<Signal> signals = seen_by({0, 0, 0, 0}, 30, 0.2);
  std::mt19937 random(3);
  std::exponential_distribution<double> exponential;
  signals[1].assign(180, 0.0);
  for (double& value : signals[2]) value = exponential(random);
  signals[3].resize(10);
  signals.emplace_back();
  const std::vector<Offset> found = align(signals, 30, 2, 1);
  for (size_t k = 1; k < signals.size(); ++k) EXPECT_FALSE(found[k].is_sure()) << k;
  Signal beat;
  for (int k = 0; k < 180; ++k) beat.push_back(k % 15 == 0 ? 5 : 1);
  for (const Offset& offset : align({beat, beat, beat}, 30, 2, 1)) EXPECT_FALSE(offset.is_sure());
  EXPECT_EQ(align({beat}, 30, 2, 1)[0].seconds, 0);
}

// A train that drives by without a halt: each camera sees a slow rise and fall of its own, and
// noise.
TEST(Align, FindsNothingInEvenMotion) {
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  int sure = 0;
  for (int trial = 0; trial < 20; ++trial) {
    std::vector<Signal> signals(8);
    for (size_t camera = 0; camera < signals.size(); ++camera) {
      const double nearest = 0.8 + 0.08 * static_cast<double>(camera);
      for (int k = 0; k < 66; ++k) {
        const double distance = k / 30.0 - nearest;
        signals[camera].push_back(5 / (1 + distance * distance) + 0.08 * normal(random));
      }
    }
    for (const Offset& offset : align(signals, 30, 5, 1)) sure += offset.is_sure() ? 1 : 0;
  }
  EXPECT_EQ(sure, 0) << "of 160";
}

// Not even near the ends, where fewer values lie to one side.
TEST(Align, FindsNoEventInAnEvenRise) {
  Signal rise;
  for (int k = 0; k < 90; ++k) rise.push_back(std::exp(0.1 * k));
  EXPECT_THAT(detail_of(rise, 30), testing::Each(0));
}

// Cameras that see other things each have a best place, too.
TEST(Align, IsSeldomSureByChance) {
  for (const double seconds : {2.0, 6.0}) {
    int sure = 0;
    for (int trial = 0; trial < 12; ++trial) {
      std::vector<double> clocks;
      for (int camera = 0; camera < 6; ++camera) clocks.push_back(8 * (trial * 6 + camera));
      std::vector<Signal> signals = seen_by(clocks, 30, 0.2);
      for (Signal& signal : signals) signal.resize(static_cast<size_t>(30 * seconds));
      for (const Offset& offset : align(signals, 30, 3, 1)) sure += offset.is_sure() ? 1 : 0;
    }
    EXPECT_LE(sure, 4) << "of 72, " << seconds << " s";
  }
}

// Eight cameras of basketball, two of which the capture has half a second and a second off.
TEST(Clocks, OfRealVideosAreFoundByMotion) {
  const std::string folder = l4d::test::data_file("basketball");
  if (folder.empty()) GTEST_SKIP() << "no basketball";
  if (!l4d::test::ffmpeg_available()) GTEST_SKIP() << "no ffmpeg";
  nlohmann::json document = nlohmann::json::parse(test::bytes_of(folder + "/cameras.json"));
  nlohmann::json cameras;
  for (const size_t index : {0U, 2U, 8U, 12U, 14U, 20U, 24U, 28U}) {
    nlohmann::json camera = document["cameras"][index];
    camera["video"] = folder + "/" + camera["video"].get<std::string>();
    if (index == 12) camera["time_offset"] = -0.5;
    if (index == 20) camera["time_offset"] = 1;
    cameras.push_back(camera);
  }
  document["cameras"] = cameras;
  const test::Folder made;
  std::ofstream(made / "cameras.json") << document;
  CaptureOptions options;
  options.any_path = true;
  const Capture capture = read_capture(made / "cameras.json", options);
  const ClockReport clocks = find_clocks(capture, 3, 0);
  EXPECT_EQ(clocks.by, "motion");
  for (size_t k = 0; k < clocks.cameras.size(); ++k) {
    const double off = k == 3 ? 0.5 : k == 5 ? -1 : 0.0;
    EXPECT_EQ(clocks.cameras[k].is_off, off != 0) << k;
    EXPECT_NEAR(clocks.cameras[k].found.seconds, off, 2 / 30.0) << k;
  }
  write_synchronised(made / "synchronised.json", capture, clocks);
  const Capture mended = read_capture(made / "synchronised.json", options);
  for (const CaptureCamera& camera : mended.cameras) {
    EXPECT_NEAR(camera.source.time_offset, 0, 2 / 30.0) << camera.name;
  }
  EXPECT_GT(mended.views.size(), capture.views.size());
}

// Claps that all cameras hear, at their own clocks.
TEST(Clocks, AreFoundBySound) {
  if (!l4d::test::ffmpeg_available()) GTEST_SKIP() << "no ffmpeg";
  const test::Folder made;
  nlohmann::json document = {{"width", 32}, {"height", 32}, {"fps", 10}};
  std::string claps;
  for (const double at : {0.6, 1.13, 1.9, 2.2, 3.07, 3.5}) {
    claps += (claps.empty() ? "" : "+") + std::string("lt(abs(t-") + std::to_string(at) + "),0.02)";
  }
  for (size_t k = 0; k < 4; ++k) {
    const double begin = k == 2 ? 0.4 : 0;  // it began later
    const std::string name = "cam" + std::to_string(k) + ".mp4";
    const std::string command =
        "ffmpeg -v error -f lavfi -i color=gray:s=32x32:r=10:d=4 -f lavfi -i "
        "\"aevalsrc='(random(" +
        std::to_string(k) + ")-0.5)*(0.02+0.9*(" + claps +
        "))':s=8000:d=4.5\" -filter_complex \"[1:a]atrim=start=" + std::to_string(begin) +
        ",asetpts=PTS-STARTPTS[a]\" -map 0:v -map \"[a]\" -t 4 '" + (made / name) + "'";
    ASSERT_EQ(std::system(command.c_str()), 0);
    document["cameras"].push_back(
        {{"id", k},
         {"video", name},
         {"K", {{30, 0, 16}, {0, 30, 16}, {0, 0, 1}}},
         {"w2c",
          {{1, 0, 0, 0.1 * static_cast<double>(k)}, {0, 1, 0, 0}, {0, 0, 1, 3}, {0, 0, 0, 1}}}});
  }
  std::ofstream(made / "cameras.json") << document;
  const ClockReport clocks = find_clocks(read_capture(made / "cameras.json", {}), 2, 0);
  EXPECT_EQ(clocks.by, "sound");
  for (size_t k = 0; k < 4; ++k) {
    EXPECT_NEAR(clocks.cameras[k].found.seconds, k == 2 ? 0.4 : 0, 0.01) << k;
    EXPECT_EQ(clocks.cameras[k].is_off, k == 2) << k;
  }
}

TEST(Align, ResamplesUnevenTimes) {
  EXPECT_THAT(resampled({0.05, 0.15, 0.35}, {1, 2, 6}, 10),
              testing::Pointwise(testing::DoubleNear(1e-12), {1.0, 1.5, 3.0, 5.0}));
  EXPECT_TRUE(resampled({}, {}, 10).empty());
}

}  // namespace
}  // namespace l4d::train
