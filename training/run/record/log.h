// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <cstdio>
#include <string>
#include <vector>

#include "training/run/train/evaluate.h"
#include "training/run/train/trainer.h"

namespace l4d::train {

// Bytes, and Gaussians. Of a report: the largest of each in the training.
struct MemoryUse {
  BackendMemory backend;
  uint64_t images = 0;                           // on the host
  uint64_t bucket_memory = 0, bucket_files = 0;  // of Gaussians that are away
  uint64_t resident = 0, away = 0;               // Gaussians
  void raise_to(const MemoryUse& other);
};
// Of now. residence: null where the whole model is in the back end.
MemoryUse memory_use(const Backend& backend, const ImageStore& images, const Residence* residence);

// Calls f(name, number) for each, as files name them.
template <typename Use, typename F>
void for_each_size(Use& use, F&& f) {
  f("model_bytes", use.backend.model);
  f("renderer_bytes", use.backend.renderer);
  f("target_bytes", use.backend.targets);
  f("image_bytes", use.images);
  f("bucket_bytes", use.bucket_memory);
  f("bucket_file_bytes", use.bucket_files);
  f("resident", use.resident);
  f("away", use.away);
}

// What the log has of a moment.
struct LogEntry {
  uint64_t step = 0;
  double seconds = 0;
  double progress = 0;
  double loss = 0, psnr = 0;  // means since the entry before, of training views
  uint64_t gaussians = 0;
  uint64_t relocated = 0, born = 0, skipped_rows = 0;  // since the entry before
  uint64_t image_bytes = 0;
  MemoryUse memory;                      // images: as image_bytes
  double image_wait = 0, swaps = 0;      // s, that steps waited
  std::array<double, kStages> stages{};  // ms a step
  bool has_score = false;
  Score train, test;  // NaN without views
  bool ends_early = false;
};

// RUN/log.jsonl, one line for each entry, which is there when `add` returns. A run that resumes
// goes on after the entries up to its step.
class Log {
 public:
  Log(const std::string& path, uint64_t resumed_step);
  void add(const LogEntry& entry);
  const std::vector<LogEntry>& entries() const { return entries_; }

 private:
  std::string path_;
  std::vector<LogEntry> entries_;
};

std::string json_of(const LogEntry& entry);  // on one line

// PSNR of training and test views and the number of Gaussians over steps, as an SVG.
std::string draw_curves(const std::vector<LogEntry>& entries);

}  // namespace l4d::train
