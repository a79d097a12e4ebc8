// SPDX-License-Identifier: Apache-2.0
#include "io/formats/instant.h"

#include <algorithm>
#include <cmath>

#include "libl4dcodec/scene/sh.h"

namespace l4d::io {
namespace {

double linear_of_srgb(double c) {
  return c <= 0.04045 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4);
}

}  // namespace

void require_finite(const Splats& splats, const std::string& path) {
  for (const std::vector<float>* values :
       {&splats.position, &splats.covariance, &splats.opacity, &splats.sh}) {
    if (!std::all_of(values->begin(), values->end(), [](float x) { return std::isfinite(x); })) {
      throw Error(L4D_ERR_INVALID_SCENE, path + ": a value of a splat is not finite");
    }
  }
}

void linear_base_color(const Splats& splats, bool is_linear, size_t i, float* rgb) {
  const size_t numbers = size_t{3} * (splats.sh_degree + 1) * (splats.sh_degree + 1);
  for (size_t k = 0; k < 3; ++k) {
    const double base = static_cast<double>(splats.sh[numbers * i + k]);
    const double c = std::clamp(0.5 + static_cast<double>(sh_constant::k0) * base, 0.0, 1.0);
    rgb[k] = static_cast<float>(is_linear ? c : linear_of_srgb(c));
  }
}

void turn_around_x(Splats* splats) {
  // Basis functions of degrees 1 to 3 that are odd in y and z together.
  constexpr size_t kOdd[] = {1, 2, 4, 7, 9, 11, 12, 14};
  const size_t coefficients = (size_t{splats->sh_degree} + 1) * (splats->sh_degree + 1);
  for (size_t i = 0; i < splats->count(); ++i) {
    float* p = &splats->position[3 * i];
    float* c = &splats->covariance[6 * i];
    for (float* x : {p + 1, p + 2, c + 1, c + 2}) *x = -*x;
    for (const size_t k : kOdd) {
      if (k >= coefficients) break;
      float* rgb = &splats->sh[3 * (coefficients * i + k)];
      for (size_t j = 0; j < 3; ++j) rgb[j] = -rgb[j];
    }
  }
}

void turn_axes(const l4d_placement& placement, uint32_t wanted, Splats* splats) {
  const uint32_t axes = placement.coordinate_system;
  if (axes != L4D_COORDINATES_UNKNOWN && axes != wanted) turn_around_x(splats);
}

}  // namespace l4d::io
