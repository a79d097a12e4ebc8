// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "io/camera/cameras.h"

namespace l4d::io {

// Cameras as a rig has them: columns x rows of them in a plane around the first view of `from`,
// which has a camera, all looking at its target. Neighbours in a row are apart by `spread` of the
// distance to the target, divided by the number of columns less one; rows are as far apart. Ids
// count by rows from the top left; the camera nearest to the middle is for tests, the others are
// for training. Throws Error(L4D_ERR_INVALID_ARGUMENT) unless columns and rows are 1 to 1000.
CameraSet grid_cameras(const l4d_presentation& from, uint32_t columns, uint32_t rows, double spread,
                       uint32_t width, uint32_t height);

}  // namespace l4d::io
