// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "io/scene/rotor_math.h"

namespace l4d::io {

// Rotation (w x y z) and standard deviations of a covariance in space.
struct Shape3 {
  Vec4 wxyz;
  Vec3 scale;
};
// Of rows rows^T.
Shape3 shape_of_rows(const std::array<Vec4, 3>& rows);
// covariance: [6] xx xy xz yy yz zz. An axis below its rounding in float32 gets 1/4096 of the
// longest.
Shape3 shape_of_covariance(const float* covariance);

}  // namespace l4d::io
