// SPDX-License-Identifier: Apache-2.0
// The contract of all rasterisers.
#pragma once

#include <cstdint>
#include <vector>

#include "l4d/render.h"
#include "libl4dcodec/base/status.h"
#include "render/frame/frame.h"
#include "render/frame/project.h"

namespace l4d::render {

struct Stats {
  uint64_t projected = 0;
  uint64_t instances = 0;
  double seconds[L4D_RENDER_PASS_COUNT] = {};
};

// Derivatives by the splats of one view, in the order of the frame's Gaussians.
template <typename T>
struct ViewGradients {
  std::vector<SplatGradient2D<T>> splat;  // [frame.count()], zero where a Gaussian is not in view
  // [frame.count()] sum over pixels of alpha times transmittance
  std::vector<T> coverage;
};

// What the backward pass needs to know of the scalar that is derived.
struct BackwardInput {
  // [height, width, 3] derivative of the scalar by each pixel, or NULL: the scalar is the sum of
  // all pixels and channels.
  const float* rgb_gradient = nullptr;
  // Not NULL, and rgb_gradient NULL: that derivative is a sign, which mix(*signs + pixel) gives.
  const uint64_t* signs = nullptr;
  // false: fills `coverage` only.
  bool geometry = true;
  // Not NULL: [Gaussians of the scene]; coverage of those marked 1 is not wanted and may stay 0.
  const uint8_t* seen = nullptr;
};

template <typename T>
class Rasterizer {
 public:
  virtual ~Rasterizer() = default;
  // rgb [height, width, 3] and alpha [height, width], either may be NULL. background [3]. Both fail
  // with LIMIT_EXCEEDED where the view needs more memory than the rasteriser may take.
  virtual Status forward(const Frame<T>& frame, const View<T>& view, const float* background,
                         float* rgb, float* alpha, Stats* stats) = 0;
  virtual Status backward(const Frame<T>& frame, const View<T>& view, const float* background,
                          const BackwardInput& input, ViewGradients<T>* out, Stats* stats) = 0;
  // Gives back what is kept for the next call.
  virtual void forget() = 0;
};

}  // namespace l4d::render
