// SPDX-License-Identifier: Apache-2.0
// From derivatives by splats to those by the attributes of the scene, and to importances.
#pragma once

#include "render/cuda/backward/backward.h"
#include "render/cuda/store/store.h"
#include "render/frame/importance_numbers.h"

namespace l4d::render {

// What the backward pass to the attributes needs of them. All arrays are on the device; a splat's
// id is its place in them.
struct GradientInput {
  l4d_gaussians gaussians;
  View<double> view;
  Sequence sequence;
  double time;  // seconds
  uint32_t
      sh_stride;  // numbers from one Gaussian's SH to the next one's, in attributes and gradients
};

// What a view shows of each Gaussian: l4d_cuda_trainable_statistics. NULL is not wanted.
struct ViewStatistics {
  uint8_t* shown;
  uint32_t* views;
  float* coverage;
  float* error_coverage;
  float* screen_gradient;
};

// Adds to those arrays of `out` and `statistics` that are not NULL, which are on the device; each
// Gaussian is in a frame once at most. As the calls below it adds nothing where the capacity did
// not suffice for all of the frame.
void launch_gradients(const GradientInput& input, const BackwardTask& task,
                      const ResidentGaussians& rows, const FrameMemory& memory,
                      const BackwardMemory& back, const l4d_gradients& out,
                      const ViewStatistics& statistics, cudaStream_t stream);

// Bytes of BackwardMemory::by_view.
size_t view_parts_bytes();

// Sums over views of importances, in whole numbers: neither the order of views nor how they are
// dealt out to devices changes them.
struct ImportanceSums {
  long long* numbers;       // [N, row.width()]
  long long* visible_only;  // [N] coverage in visibility-only views, of what no full view had shown
  uint8_t* seen;            // [N]
  ImportanceRow row;
  bool sum_visible_only;  // all of them add up; else the first one tells
};

// Adds magnitudes of derivatives, or, where squared, squares of derivatives by attributes as
// streams code them.
void launch_importance(const GradientInput& input, const BackwardTask& task, bool squared,
                       const ResidentGaussians& rows, const FrameMemory& memory,
                       const BackwardMemory& back, const ImportanceSums& sums, cudaStream_t stream);
// Adds the sums of other views.
void launch_add_sums(const ImportanceSums& from, size_t count, const ImportanceSums& to,
                     cudaStream_t stream);
// Adds coverage of what has not been seen, or of all, and marks it as seen. coverage as
// launch_coverage has it.
void launch_visible_only(const ResidentGaussians& rows, const FrameMemory& memory,
                         const unsigned long long* coverage, const ImportanceSums& sums,
                         cudaStream_t stream);

}  // namespace l4d::render
