// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "render/frame/scene.h"

namespace l4d::render {

// Open streams that are shown together, each on a clock of its own.
class Streams {
 public:
  // Borrows the decoders.
  void set(l4d_decoder* const* decoders, const double* shifts, size_t count, MemoryBudget& memory);
  // The Gaussians of all that are visible at `time`, stream after stream; decoders clamp.
  Status slice(double time, MemoryBudget& memory, Frame<float>* out);
  // What slices left in the frame is no longer there.
  void restart();
  void forget(MemoryBudget& memory);

 private:
  struct Part {
    l4d_decoder* decoder;
    double shift;  // time of the frame less time of the stream
    uint64_t still_key = 0;
    Frame<float> frame;  // unless there is one stream only
  };
  // Gives rows of SH of fewer coefficients those that `degree` has, as zeros.
  Status widen_sh(uint32_t degree, MemoryBudget& memory, Frame<float>* out);

  std::vector<Part> parts_;
  std::vector<float> wide_sh_;
};

}  // namespace l4d::render
