// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <chrono>
#include <cstddef>

namespace l4d::train {

// What a run does, one after the other, as report.json names it. kImageWait and kSwaps: what steps
// wait for. kSwaps: Gaussians move between the back end and elsewhere.
enum Part : size_t {
  kCapture,  // reading its description, and its files for the hash
  kImages,
  kStart,
  kSteps,
  kImageWait,
  kSwaps,
  kScoring,  // while training, and previews
  kWriting,  // checkpoints, the log, the scene
  kComparison,
  kEncoding,
  kParts
};
constexpr std::array<const char*, kParts> kPartNames = {"capture",    "images",  "start",  "steps",
                                                        "image_wait", "swaps",   "scores", "files",
                                                        "comparison", "encoding"};

// Seconds of each part. Time counts for the part that was begun last.
class PartTimes {
 public:
  void begin(Part part) {
    const Clock::time_point now = Clock::now();
    seconds_[part_] += std::chrono::duration<double>(now - since_).count();
    since_ = now;
    part_ = part;
  }
  // waits: seconds of steps that count for kImageWait and kSwaps.
  std::array<double, kParts> seconds(double image_wait, double swaps) {
    begin(part_);
    std::array<double, kParts> out = seconds_;
    out[kSteps] -= image_wait + swaps;
    out[kImageWait] = image_wait;
    out[kSwaps] = swaps;
    return out;
  }

 private:
  using Clock = std::chrono::steady_clock;
  std::array<double, kParts> seconds_{};
  Clock::time_point since_ = Clock::now();
  Part part_ = kCapture;
};

}  // namespace l4d::train
