// SPDX-License-Identifier: Apache-2.0
// The numbers that importances are made of, on the host and on devices.
#pragma once

#include <cstdint>

#include "l4d/render.h"
#include "libl4dcodec/scene/sh.h"

namespace l4d::render {

// Derivatives by geometry: 4 log scales, 8 rotor coefficients, 3 coordinates of the position,
// opacity, mean time; and those of each attribute that has a weight of its own.
constexpr uint32_t kGeometryNumbers = 17;
struct GeometryPart {
  uint32_t weight, first, count;
};
constexpr uint32_t kNumGeometryParts = 6;
constexpr GeometryPart kGeometryParts[kNumGeometryParts] = {
    {L4D_WEIGHT_SCALE, 0, 4},          {L4D_WEIGHT_ROTOR_SPATIAL, 4, 4},
    {L4D_WEIGHT_ROTOR_TEMPORAL, 8, 4}, {L4D_WEIGHT_POSITION, 12, 3},
    {L4D_WEIGHT_OPACITY, 15, 1},       {L4D_WEIGHT_MEAN_T, 16, 1}};

// What is added up over views for each Gaussian, a row of numbers: coverage, then SH, then
// geometry. Of magnitudes one number for each SH term and coordinate; of squares, whose mean over
// an attribute is what counts, one for each attribute.
struct ImportanceRow {
  uint32_t sh = 0, geometry = 0;
  L4D_HOST_DEVICE uint32_t width() const { return 1 + sh + geometry; }
};
inline ImportanceRow importance_row(uint32_t metric, uint32_t sh_degree) {
  if (metric == L4D_SENSITIVITY_GAUSS_NEWTON) return {1, kNumGeometryParts};
  return {sh_terms(sh_degree), kGeometryNumbers};
}

// A well-mixed hash of a counter (splitmix64's finaliser). Signs are made of it, which so depend on
// seed, view, pixel and channel alone: bits 0..2 of mix(base + pixel) are those of its channels.
L4D_HOST_DEVICE inline uint64_t mix(uint64_t x) {
  x += 0x9e3779b97f4a7c15u;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
  return x ^ (x >> 31);
}

// The sign of a channel: bits is mix(base + pixel).
L4D_HOST_DEVICE inline float sign_of(uint64_t bits, int channel) {
  return (bits >> channel & 1) != 0 ? 1.0f : -1.0f;
}

// Sums as whole numbers of small units, the same in any order: binary places of each kind, and
// where what does not fit stays.
constexpr int kCoverageBits = 24;
constexpr int kShBits = 24;
constexpr int kGeometryBits = 20;
constexpr int kWholeBits = 59;
constexpr int64_t kMostWhole = int64_t{1} << kWholeBits;

}  // namespace l4d::render
