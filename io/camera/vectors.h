// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>

#include "io/scene/rotor_math.h"

namespace l4d::io {

inline double length(const Vec3& a) { return std::sqrt(dot(a, a)); }
// a + s b
inline Vec3 ahead(const Vec3& a, double s, const Vec3& b) {
  return {a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]};
}
inline Vec3 minus(const Vec3& a, const Vec3& b) { return ahead(a, -1, b); }
inline Vec3 unit(const Vec3& a) { return ahead({0, 0, 0}, 1 / length(a), a); }

}  // namespace l4d::io
