// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "render/frame/scene.h"

namespace l4d::render {

// Open streams that are shown together, each on a clock of its own.
class Streams {
 public:
  // Borrows the decoders. point: what is shown of each.
  void set(l4d_decoder* const* decoders, const double* shifts, size_t count,
           const l4d_operating_point& point);
  // The Gaussians of all that are visible at `time`, stream after stream; decoders clamp.
  Status slice(double time, MemoryBudget& memory, Frame<float>* out);
  // What slices left in the frame is no longer there.
  void restart() { still_key_ = 0; }

 private:
  std::vector<l4d_shown_stream> streams_;
  std::vector<double> shifts_;  // [streams] time of the frame less time of the stream
  l4d_operating_point point_{};
  uint64_t still_key_ = 0;
};

}  // namespace l4d::render
