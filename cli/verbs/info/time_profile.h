// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "cli/command/context.h"
#include "cli/command/progress.h"
#include "cli/input/scene_source.h"
#include "l4d/experimental/inspect.h"

namespace l4d::cli {

// What playing a stream from begin to end takes, step by step: one frame each, or several where
// there are many. A player that keeps the buckets it has fetched while they may be visible.
struct TimeProfile {
  l4d_timeline timeline{};
  uint32_t frames_per_step = 1;
  std::vector<double> times;                 // of each step, seconds
  std::vector<uint32_t> levels;              // temporal levels, rising
  std::vector<double> bucket_widths;         // of each, seconds
  std::vector<std::vector<uint64_t>> bytes;  // [level][step]: pages of buckets that come into sight
  std::vector<uint64_t> directory_bytes;     // [step]: directory read for them
  std::vector<uint64_t> gaussians;           // [step]: of the buckets that may be visible
  std::vector<uint64_t> visible;             // [step]: that are
  uint64_t setup_bytes = 0;                  // headers, codebooks, tables: read once

  uint64_t step_bytes(size_t step) const;
  // Up to the first image: setup_bytes and the first step.
  uint64_t opening_bytes() const { return setup_bytes + step_bytes(0); }
  double step_seconds() const;
  // After the first step: on average, and in the worst second (or all steps, if they are shorter).
  double mean_rate() const;
  double peak_rate() const;

  Json json() const;
  std::string text() const;
  std::string svg(const std::string& title) const;
};

// sections: of the stream, [L4D_SECTION_COUNT].
TimeProfile profile_over_time(const SceneStream& stream, const std::vector<l4d_layer_info>& layers,
                              const std::vector<uint64_t>& sections, Progress& progress);

}  // namespace l4d::cli
