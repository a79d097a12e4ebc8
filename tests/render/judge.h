// SPDX-License-Identifier: Apache-2.0
// Why a pixel of the fast path is not that of the reference.
//
// Blending decides: where a pixel stops, which of two splats of one depth comes first, which are
// too faint to count. Rounding can turn a decision that is close, and then the pixel jumps. The
// judge takes the decisions that the fast path made in a pixel, blends the reference's numbers by
// them, and looks whether that gives the fast path's pixel; and how close each decision was.
#pragma once

#include <vector>

#include "render/cpu/fast/bins.h"
#include "render/frame/project.h"

namespace l4d::render {

struct Verdict {
  bool explained = false;  // the decisions give the pixel, and all that differ were close
  // Decisions that the reference makes otherwise.
  int stops = 0, swaps = 0, skips = 0;
  // The worst of them: how far from the limit, relative to it and to what rounding may do.
  double stop_distance = 0, swap_distance = 0, skip_distance = 0;
  double left = 0;  // largest difference that the decisions do not explain
};

class Judge {
 public:
  // Frames of one instant, rows alike.
  Judge(const Frame<float>& frame, const Frame<double>& reference, const l4d_camera& camera,
        bool fast_exponential);
  // rgb [3]: the fast path's pixel, on black. alpha_error: what its alphas may be off, relatively.
  Verdict judge(int x, int y, const float* rgb, double alpha_error) const;

 private:
  std::vector<size_t> blended(int x, int y) const;
  double alpha_of(size_t row, int x, int y) const;
  double depth_error(size_t row) const;

  const Frame<double>& reference_;
  View<double> view_;
  bool fast_exponential_;
  std::vector<FastSplat> splats_;  // front to back
  TileBins bins_;
  std::vector<Splat<double>> expected_;  // [rows]
  std::vector<bool> in_view_;            // [rows]
};

}  // namespace l4d::render
