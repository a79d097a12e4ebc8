// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "eval/views/views.h"
#include "io/ply/weights.h"
#include "io/scene/scene.h"
#include "l4d/render.h"

namespace l4d::eval {

struct MeasuredImportance {
  io::Weights weights;  // of all components
  l4d_measure_report report{};
  double seconds = 0;
};

// How to measure Gauss-Newton weights from at most so many views, whether they agree or not; 0:
// until they agree.
l4d_measure_options measure_options(size_t most_views, size_t num_views, uint64_t seed);

// The importance of each Gaussian for the views, as l4d_measure_importance has it.
MeasuredImportance measure_importance(const l4d_renderer_options& rendering, const io::Scene& scene,
                                      const CameraViews& views, const l4d_measure_options& options);

}  // namespace l4d::eval
