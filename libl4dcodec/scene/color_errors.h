// SPDX-License-Identifier: Apache-2.0
// How far the colours of one Gaussian are from those of another (spec: section 8.5).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include "libl4dcodec/scene/sh.h"

namespace l4d {

struct ColorErrors {
  double base = 0;
  double directional = 0;
};

// sqrt((2l + 1) / (4 pi)), l = 1..3: by the addition theorem, the most that coefficients of degree
// l and of Euclidean norm 1 add in any direction.
constexpr double kMostOfDegree[] = {0.48860251190291992, 0.63078313050504009, 0.74635266518023078};

// What degrees 1.. of channel c add to a colour in any direction, at most. number(i): number i of
// the [coefficients, 3].
template <typename Number>
double most_directional(const Number& number, size_t coefficients, size_t c) {
  double sum = 0;
  for (size_t l = 1; (l + 1) * (l + 1) <= coefficients; ++l) {
    double norm2 = 0;
    for (size_t k = l * l; k < (l + 1) * (l + 1); ++k) {
      const double x = number(3 * k + c);
      norm2 += x * x;
    }
    sum += kMostOfDegree[l - 1] * std::sqrt(norm2);
  }
  return sum;
}

// Errors of `decoded` against `original`, SH of [coefficients, 3] each: in colour units, or in
// parts of the largest colour of the original where that is more than 1.
inline ColorErrors color_errors(const float* original, const float* decoded, size_t coefficients) {
  double largest = 1;
  ColorErrors e;
  for (size_t c = 0; c < 3; ++c) {
    const auto given = [&](size_t i) { return static_cast<double>(original[i]); };
    const auto off = [&](size_t i) { return static_cast<double>(decoded[i]) - given(i); };
    largest = std::max({largest, std::fabs(0.5 + sh_constant::k0 * given(c)),
                        most_directional(given, coefficients, c)});
    e.base = std::max(e.base, sh_constant::k0 * std::fabs(off(c)));
    e.directional = std::max(e.directional, most_directional(off, coefficients, c));
  }
  e.base /= largest;
  e.directional /= largest;
  return e;
}

}  // namespace l4d
