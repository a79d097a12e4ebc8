// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "training/step/backend.h"

namespace l4d::train {

// Views [begin, end) of a step. May be none.
struct ViewRange {
  size_t begin = 0, end = 0;
  size_t count() const { return end - begin; }
};

// Numbers of rows that a step adds up over its views.
struct SumArray {
  enum Kind : uint32_t { kFloat, kCount, kFlag };  // float; uint32_t; uint8_t, of which any counts
  void* data;                                      // [rows, width]
  uint32_t width;
  Kind kind;
};

// The sums of a step, where the back end has them.
struct StepSums {
  uint64_t rows = 0;  // in use
  std::vector<SumArray> arrays;
  // [1] not 0: a loss is not finite, or a view did not fit. Of the views of the back end alone, and
  // of those of all back ends.
  const uint32_t* stop = nullptr;
  uint32_t* stop_any = nullptr;
  // Of back ends on devices: sums are complete in the order of the stream, and work that waits for
  // their exchange goes there.
  int device = -1;
  void* stream = nullptr;
};

// A back end whose step has phases, so that several can share the views of one step: each renders
// some, they add their sums up, and each updates its model from the same sums. Phases may launch
// work and return before it is done; only `finish` waits.
class PhasedBackend : public Backend {
 public:
  // Of all views, by this back end alone.
  StepOutput step(const StepInput& input) final;

  // Renders the views of the range, and adds up what they say of each row. What a step that was not
  // finished had added up is forgotten.
  virtual void render_views(const StepInput& input, ViewRange range) = 0;
  // Borrowed until the update, which then goes by `stop_any`.
  virtual StepSums sums() = 0;
  // Updates the model from the sums of all views, and forgets them. Leaves the model alone where
  // the step is to stop.
  virtual void update(const StepInput& input) = 0;
  // Returns false if the step has to be repeated from render_views on: a view did not fit. Views
  // and exposures of the output are those of the range.
  virtual bool finish(const StepInput& input, ViewRange range, StepOutput* output) = 0;
};

// As make_cpu_backend.
std::unique_ptr<PhasedBackend> make_phased_cpu_backend(uint32_t threads);

}  // namespace l4d::train
