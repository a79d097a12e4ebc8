// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "io/scene/rotor_math.h"

namespace l4d::io::synth {

// The view-dependent basis functions 1..15 towards a unit vector, with the signs of 3DGS.
inline void sh_basis(const Vec3& d, double* out /* [15] */) {
  const double x = d[0], y = d[1], z = d[2];
  const double xx = x * x, yy = y * y, zz = z * z;
  out[0] = -0.48860251190291992 * y;
  out[1] = 0.48860251190291992 * z;
  out[2] = -0.48860251190291992 * x;
  out[3] = 1.0925484305920792 * x * y;
  out[4] = -1.0925484305920792 * y * z;
  out[5] = 0.31539156525252005 * (2 * zz - xx - yy);
  out[6] = -1.0925484305920792 * x * z;
  out[7] = 0.54627421529603959 * (xx - yy);
  out[8] = -0.59004358992664352 * y * (3 * xx - yy);
  out[9] = 2.8906114426405538 * x * y * z;
  out[10] = -0.45704579946446572 * y * (4 * zz - xx - yy);
  out[11] = 0.37317633259011546 * z * (2 * zz - 3 * xx - 3 * yy);
  out[12] = -0.45704579946446572 * x * (4 * zz - xx - yy);
  out[13] = 1.4453057213202769 * z * (xx - yy);
  out[14] = -0.59004358992664352 * x * (xx - 3 * yy);
}

}  // namespace l4d::io::synth
