// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "io/camera/cameras.h"
#include "io/scene/scene.h"

namespace l4d::eval {

// Half a pixel of the nearest camera, in scene units, for each Gaussian: as near as it comes to the
// camera while it is visible, whichever way the camera looks.
std::vector<float> min_sizes(const io::Scene& scene, const io::CameraSet& cameras,
                             uint32_t threads);

}  // namespace l4d::eval
