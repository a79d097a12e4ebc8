// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <stdexcept>

#include "training/run/report/run_report.h"
#include "training/run/setup/run_options.h"

// Whole trainings, from a capture to a folder of results.
namespace l4d::train {

// The losses rose without bound again after going on from a checkpoint.
class TrainingFailed : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Throws io::Error where options are wrong whatever the capture: train() does, before it reads
// anything.
void check_options(const RunOptions& options);

// Writes to the folder: settings.json, log.jsonl, events for TensorBoard, curves.svg, preview.png,
// checkpoints; at the end scene.ply, cameras.json, report.json, and with a preset weights.ply and
// scene.l4d. Throws io::Error, l4d::Error, TrainingFailed.
RunReport train(const RunOptions& options, RunObserver* observer);

}  // namespace l4d::train
