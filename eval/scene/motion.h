// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>

#include "io/scene/rotor_math.h"
#include "io/scene/scene.h"
#include "libl4dcodec/scene/window.h"

namespace l4d::eval {

// What a Gaussian does over time, in double precision, so that comparing two of them adds no error
// of its own.
struct Motion {
  io::Vec3 position;  // at `anchor`
  io::Vec3 velocity;  // scene units per second
  double anchor;      // seconds
  // Of a flat window: its middle, a quarter of its half, and 0: it fills its visible span.
  double mean_t;                     // seconds
  double sigma_t;                    // seconds
  double lambda;                     // 1 / sigma_t^2
  std::array<double, 6> covariance;  // of the slice: xx xy xz yy yz zz

  io::Vec3 at(double seconds) const;
};
Motion motion_of(const io::Scene& scene, size_t index);
// With a mean time that the scene holds rounded.
Motion motion_of(const io::Scene& scene, size_t index, double mean_t);

FrameWindow window_in(const io::Scene& scene, size_t index);

// Opacity in [0, 1], whatever form the scene holds it in.
double linear_opacity(const io::Scene& scene, size_t index);

// When a Gaussian contributes: at most 4 standard deviations from its mean time, within [begin,
// end].
struct VisibleSpan {
  double begin, end;
  bool empty() const { return !(begin <= end); }
};
VisibleSpan visible_span(const Motion& motion, double begin, double end);

}  // namespace l4d::eval
