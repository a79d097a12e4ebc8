// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "libl4dcodec/math/hd.h"

namespace l4d {

L4D_HOST_DEVICE constexpr uint32_t sh_terms(uint32_t degree) { return (degree + 1) * (degree + 1); }
constexpr uint32_t kMaxShTerms = 16;

// Real spherical harmonics with the constants and signs of 3D Gaussian splatting.
namespace sh_constant {
constexpr double k0 = 0.28209479177387814;
constexpr double k1 = 0.4886025119029199;
constexpr double k2[5] = {1.0925484305920792, -1.0925484305920792, 0.31539156525252005,
                          -1.0925484305920792, 0.5462742152960396};
constexpr double k3[7] = {-0.5900435899266435, 2.890611442640554,   -0.4570457994644658,
                          0.3731763325901154,  -0.4570457994644658, 1.445305721320277,
                          -0.5900435899266435};
}  // namespace sh_constant

// Values of the (degree + 1)^2 basis functions in the unit direction (x, y, z).
template <typename T>
L4D_HOST_DEVICE inline void sh_basis(uint32_t degree, T x, T y, T z,
                                     T* basis /* [(degree + 1)^2] */) {
  using namespace sh_constant;
  const auto c = [](double v) { return static_cast<T>(v); };
  basis[0] = c(k0);
  if (degree < 1) return;
  basis[1] = c(-k1) * y;
  basis[2] = c(k1) * z;
  basis[3] = c(-k1) * x;
  if (degree < 2) return;
  const T xx = x * x, yy = y * y, zz = z * z;
  basis[4] = c(k2[0]) * (x * y);
  basis[5] = c(k2[1]) * (y * z);
  basis[6] = c(k2[2]) * (c(2) * zz - xx - yy);
  basis[7] = c(k2[3]) * (x * z);
  basis[8] = c(k2[4]) * (xx - yy);
  if (degree < 3) return;
  basis[9] = c(k3[0]) * y * (c(3) * xx - yy);
  basis[10] = c(k3[1]) * (x * y) * z;
  basis[11] = c(k3[2]) * y * (c(4) * zz - xx - yy);
  basis[12] = c(k3[3]) * z * (c(2) * zz - c(3) * xx - c(3) * yy);
  basis[13] = c(k3[4]) * x * (c(4) * zz - xx - yy);
  basis[14] = c(k3[5]) * z * (xx - yy);
  basis[15] = c(k3[6]) * x * (xx - c(3) * yy);
}

// The unit direction from `from` to `to`, `where_equal` if they are the same point.
template <typename T>
L4D_HOST_DEVICE inline void direction_from(const T* from /* [3] */, const T* to /* [3] */,
                                           const T* where_equal /* [3] */, T* out /* [3] */) {
  T d[3], norm2 = 0;
  for (int k = 0; k < 3; ++k) {
    d[k] = to[k] - from[k];
    norm2 += d[k] * d[k];
  }
  const T norm = std::sqrt(norm2);
  for (int k = 0; k < 3; ++k) out[k] = norm > 0 ? d[k] / norm : where_equal[k];
}

// 0.5 + SH, not yet clamped. sh[i]: [(degree + 1)^2, 3].
template <typename T, typename Coefficients>
L4D_HOST_DEVICE inline void sh_color(uint32_t degree, const Coefficients& sh,
                                     const T* direction /* [3] */, T* color /* [3] */) {
  T basis[kMaxShTerms];
  sh_basis(degree, direction[0], direction[1], direction[2], basis);
  for (int c = 0; c < 3; ++c) color[c] = static_cast<T>(0.5);
  for (uint32_t k = 0; k < sh_terms(degree); ++k) {
    for (uint32_t c = 0; c < 3; ++c) color[c] += basis[k] * static_cast<T>(sh[3 * k + c]);
  }
}

template <typename T>
L4D_HOST_DEVICE inline void clamp_color(T* color /* [3] */) {
  for (int c = 0; c < 3; ++c) color[c] = std::max(color[c], static_cast<T>(0));
}

}  // namespace l4d
