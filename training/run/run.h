// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <string>
#include <vector>

#include "training/run/log.h"
#include "training/run/settings.h"
#include "training/run/times.h"

// Whole trainings, from a capture to a folder of results.
namespace l4d::train {

struct RunOptions {
  Settings settings;
  std::string folder;
  std::string preset;  // of the encoder; "" = no stream
  std::string lpips;   // file of weights, to report LPIPS; "" = it is not reported
  std::string cache;   // folder of FrameCache; "" = none
  uint64_t cache_bytes = uint64_t{64} << 30;  // at most
  bool resume = false;
  bool accept_changes = false;    // resumes also where the capture is not as it was
  bool force = false;             // replaces a run that is there
  uint64_t limit_memory = 0;      // bytes of the whole process; 0 = none. See docs/training.md
  bool may_shrink_images = true;  // to keep to it, Settings::host_memory may become less
  uint32_t threads = 0;
  // Bytes of Gaussians that are away from the back end; more are in files of the folder.
  uint64_t bucket_memory = uint64_t{8} << 30;
  double checkpoint_seconds = 300;
  double preview_seconds = 10;
};

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
  Score train, test;
  uint64_t stream_bytes = 0;  // 0: none
  Score stream_train, stream_test;
  std::string lpips;  // the network whose distances scores have; "" = none
  std::vector<std::string> notes;
};
std::string json_of(const RunReport& report);

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

// The losses rose without bound again after going on from a checkpoint.
class TrainingFailed : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Writes to the folder: settings.json, log.jsonl, events for TensorBoard, curves.svg, preview.png,
// checkpoints; at the end scene.ply, cameras.json, report.json, and with a preset weights.ply and
// scene.l4d. Throws io::Error, l4d::Error, TrainingFailed.
RunReport train(const RunOptions& options, RunObserver* observer);

// Scores the scene of a run, and its stream if there is one, against its capture. moved: where the
// capture is now, or "" where it is as the run has it. lpips: as in RunOptions.
RunReport evaluate_run(const std::string& folder, const std::string& moved,
                       const std::string& lpips, uint32_t threads, RunObserver* observer);

// What a capture is: for people, and a contact sheet of the first images of all cameras.
struct Inspection {
  std::string text;
  std::string json;
};
// sheet: a PNG to write, or "". cache: the folder of --cache, or "".
Inspection inspect(const std::string& path, const CaptureOptions& options, const std::string& sheet,
                   const std::string& cache, uint32_t threads);

}  // namespace l4d::train
