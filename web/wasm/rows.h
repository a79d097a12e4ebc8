// SPDX-License-Identifier: Apache-2.0
// The Gaussians of a bucket as textures of a player hold them: what of each does not change with
// time.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

#include "libl4dcodec/scene/prepare.h"
#include "web/wasm/unset.h"

namespace l4d::web {

// A row is four texels of binary32: position at the reference time and opacity; velocity and
// reference time; covariance xx xy xz yy; covariance yz zz, mean time and lambda. Times are seconds
// from the centre of the bucket. Of a Gaussian with a flat window, the last two are the frame in
// which it begins, and the negative of that in which it ends. SH are binary16 numbers in texels of
// four.
struct Rows {
  static constexpr size_t kGeometry = 16;
  size_t count = 0;
  size_t sh_stride = 0;
  Unset<float> geometry;  // [count, kGeometry]
  Unset<uint16_t> sh;     // [count, sh_stride]

  // Leaves out what is never visible and what is not finite. The falloff of permanent layers is not
  // looked at. halves: SH as the decoder writes them. sh_degree: of the rows, at least that of the
  // Gaussians.
  void fill(const l4d_gaussians& g, const float* mean_t_local, const uint16_t* halves,
            const l4d_timeline& timeline, double center, bool permanent, uint32_t sh_degree) {
    const auto terms = [](size_t degree) { return 3 * (degree + 1) * (degree + 1); };
    const size_t numbers = terms(g.sh_degree);
    const Sequence sequence = sequence_of(timeline);
    sh_stride = (terms(sh_degree) + 3) / 4 * 4;
    count = 0;
    const size_t n = static_cast<size_t>(g.count);
    geometry.resize(n * kGeometry);
    sh.resize(n * sh_stride);
    std::vector<double> mean(n);
    for (size_t i = 0; i < n; ++i) mean[i] = center + static_cast<double>(mean_t_local[i]);
    l4d_gaussians exact = g;
    exact.mean_t_double = mean.data();
    for (size_t i = 0; i < n; ++i) {
      const Prepared p = prepare_gaussian(exact, sequence, i);
      if (!(p.opacity >= kMinAlpha)) continue;
      float* row = geometry.data() + kGeometry * count;
      const Slice4D<double>& s = p.slice;
      const double values[kGeometry] = {p.position[0],
                                        p.position[1],
                                        p.position[2],
                                        p.opacity,
                                        s.velocity[0],
                                        s.velocity[1],
                                        s.velocity[2],
                                        p.reference - center,
                                        s.covariance[0],
                                        s.covariance[1],
                                        s.covariance[2],
                                        s.covariance[3],
                                        s.covariance[4],
                                        s.covariance[5],
                                        p.window.is_flat() ? p.window.begin
                                        : permanent        ? 0
                                                           : p.mean - center,
                                        p.window.is_flat() ? -static_cast<double>(p.window.end)
                                        : permanent        ? 0
                                                           : s.lambda};
      float sum = 0;
      for (size_t k = 0; k < kGeometry; ++k) {
        row[k] = static_cast<float>(values[k]);
        sum += 0.0f * row[k];
      }
      if (!std::isfinite(sum)) continue;
      uint16_t* coefficients = sh.data() + sh_stride * count;
      std::copy_n(halves + numbers * i, numbers, coefficients);
      for (size_t k = numbers; k < sh_stride; ++k) coefficients[k] = 0;
      ++count;
    }
  }
};

}  // namespace l4d::web
