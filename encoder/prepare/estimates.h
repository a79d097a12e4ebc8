// SPDX-License-Identifier: Apache-2.0
// What Gaussians are thought to matter in images where nothing was measured.
#pragma once

#include <array>
#include <vector>

#include "encoder/prepare/scene.h"

namespace l4d {

// Stand-in for how much of the pictures shows Gaussian i: how large and for how long.
double shown_area(const EncoderScene& scene, size_t i);

// Stand-in for a measured weight: how much of the pictures, for how long, how opaque.
float proxy_weight(const EncoderScene& scene, size_t i);

// The part of the image that each Gaussian is, as estimated from opacity, size and life. Of scenes
// that are not lossless. sum: of the estimates that shares are parts of; 0 = of this scene, which
// it becomes.
std::vector<double> estimated_shares(const EncoderScene& scene, double* sum);

// Mean squared change of the image by a change of one number of a Gaussian.
struct ImageSquares {
  double component[L4D_COMPONENT_COUNT];
  double position;  // of a coordinate, scene units
};

// How the shape of a Gaussian bears on what its numbers change: a needle shows how it is turned and
// where it lies across itself, a ball does not. The scene is borrowed.
class ShapeFactors {
 public:
  explicit ShapeFactors(const EncoderScene& scene);

  // For a Gaussian that is `share` of the image.
  ImageSquares squares(size_t i, double share) const;
  // The square of a coordinate in squares of a log scale.
  double position_per_scale(size_t i) const { return position_per_scale(sizes(i)); }
  // The square of a number of the temporal rotor in squares of a coordinate.
  double temporal_per_position(size_t i) const;

 private:
  // Spatial standard deviations, largest first; none is below what images show.
  using Sizes = std::array<double, 3>;
  Sizes sizes(size_t i) const;
  static double position_per_scale(const Sizes& sizes);

  const EncoderScene& scene_;
  double least_ = 0;  // scene units
};

}  // namespace l4d
