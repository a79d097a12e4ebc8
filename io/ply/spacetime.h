// SPDX-License-Identifier: Apache-2.0
// Gaussians of Spacetime Gaussians, which move along cubic curves and turn at a constant rate, as
// 4D-rotor Gaussians.
#pragma once

#include <cstddef>
#include <vector>

#include "io/scene/scene.h"

namespace l4d::io {

// What such a Gaussian has beside position, spatial log scales, opacity and colour. Time is that of
// the sequence, from 0 to 1. With dt = time - center:
//   position(t) = position + motion[0..2] dt + motion[3..5] dt^2 + motion[6..8] dt^3
//   rotation(t) = quaternion + dt turning_rate, normalised
//   opacity(t)  = opacity exp(-(dt / width)^2)
struct SpacetimeRows {
  std::vector<float> quaternion;    // [N, 4] w x y z
  std::vector<float> turning_rate;  // [N, 4]
  std::vector<float> motion;        // [N, 9]
  std::vector<float> center;        // [N]
  std::vector<float> log_width;     // [N] natural logarithm
  explicit SpacetimeRows(size_t count)
      : quaternion(count * 4),
        turning_rate(count * 4),
        motion(count * 9),
        center(count),
        log_width(count) {}
  // Of a row, for what counts memory.
  static constexpr size_t kFloats = 4 + 4 + 9 + 1 + 1;
};

// Width of a falloff exp(-(dt / width)^2) over the standard deviation of the same falloff.
inline constexpr double kWidthOfSigma = 1.4142135623730951;

// Sets mean times, rotors and temporal scales of a scene that has its timeline, its positions (at
// mean times, which curves move) and its spatial log scales. Curves become the straight lines that
// fit best while visible, and turning stops; notes have the errors of both. A Gaussian with a
// number that is not finite becomes an invalid one (store_invalid_shape).
void store_spacetime(const SpacetimeRows& rows, Scene& scene);

}  // namespace l4d::io
