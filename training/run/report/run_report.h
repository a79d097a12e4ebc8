// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "eval/refit/refit.h"
#include "training/run/record/log.h"
#include "training/run/setup/settings.h"
#include "training/run/setup/times.h"

// What a run says of itself, at its end and meanwhile.
namespace l4d::train {

struct RunReport {
  Settings settings;  // as they were resolved
  std::string layout;
  uint64_t cameras = 0, training_images = 0, test_images = 0;
  uint32_t width = 0, height = 0;
  uint64_t steps = 0, gaussians = 0;
  double training_seconds = 0;           // without reading images, scores and the encoder
  std::vector<uint32_t> devices;         // none: a processor
  std::array<double, kStages> stages{};  // ms a step, since the last resume
  double total_seconds = 0;
  std::array<double, kParts> seconds{};  // of parts, since the last resume
  MemoryUse memory;
  Colour background{};  // on which scores are, where images have alpha
  Score train, test;
  uint64_t stream_bytes = 0;                           // 0: none
  std::optional<eval::CheckedStream> stream_fidelity;  // against the scene
  Score stream_train, stream_test;
  std::string lpips;  // the network whose distances scores have; "" = none
  // Training cameras with what --refine-times and --refine-cameras have found.
  std::vector<std::pair<std::string, CameraChange>> refined;
  std::vector<std::string> notes;
};

// Hears of a run, and can end it.
class RunObserver {
 public:
  virtual ~RunObserver() = default;
  // done of total; `stage` is for people. total 0: not counted.
  virtual void update(uint64_t done, uint64_t total, const std::string& stage) = 0;
  virtual void note(const std::string& text) = 0;
  // The run is to end after a checkpoint: it throws io::Error(CANCELLED).
  virtual bool cancelled() = 0;
  // A checkpoint is wanted now. Returns true once for each time.
  virtual bool wants_checkpoint() { return false; }
};

}  // namespace l4d::train
