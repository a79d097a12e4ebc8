// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

// What ColorVideoVDP makes of images before it compares them (doi 10.1145/3658144).
namespace l4d::eval {

struct Plane {
  uint32_t width = 0, height = 0;
  std::vector<float> values;  // [height, width]
  Plane() = default;
  Plane(uint32_t w, uint32_t h) : width(w), height(h), values(size_t{w} * h) {}
  float* row(uint32_t y) { return &values[size_t{width} * y]; }
  const float* row(uint32_t y) const { return &values[size_t{width} * y]; }
};

// Half the size, rounded up.
Plane reduce(const Plane& in, uint32_t threads);
// The values of a level of the next size, between those of one of half that size.
Plane expand(const Plane& in, uint32_t width, uint32_t height, uint32_t threads);
// By a Gaussian of sigma 3, borders mirrored; levels of 6 pixels or less a side stay as they are.
void blur(Plane* plane, uint32_t threads);

// Cycles per degree of each band, the base band last.
std::vector<double> band_frequencies(uint32_t width, uint32_t height, double pixels_per_degree);

}  // namespace l4d::eval
