// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "libl4dcodec/math/hd.h"

namespace l4d::render {

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

}  // namespace l4d::render
