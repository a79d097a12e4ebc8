// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>

#include "l4d/render.h"

namespace l4d::train {

// What a training finds of a camera beyond what its capture says; all 0: nothing.
using CameraChange = std::array<double, 8>;
constexpr size_t kTime = 0;   // s by which its images were taken later
constexpr size_t kTurn = 1;   // [3] rotation vector about its own axes, rad
constexpr size_t kMove = 4;   // [3] what then comes, along them, in units of the capture
constexpr size_t kFocal = 7;  // ln of a factor of both focal lengths

// The camera with its change of place and lens.
l4d_camera changed(const l4d_camera& camera, const CameraChange& change);

}  // namespace l4d::train
