// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "io/camera/cameras.h"
#include "io/scene/scene.h"

namespace l4d::train {

// Writes `count` points of what the training cameras see in the middle of the sequence, as
// structure from motion finds them: a PLY with x y z, red green blue, and t, the seconds of the
// capture. Each is the centre of a Gaussian, drawn by the share of the images that it fills, and is
// off by a pixel of the nearest camera (standard deviation). There are fewer where fewer
// Gaussians are seen. begin: the second of the scene at which the capture begins; middle: of the
// capture. Throws io::Error.
void write_capture_points(const std::string& path, const io::Scene& scene, const io::CameraSet& set,
                          uint32_t count, double begin, double middle, uint32_t threads);

}  // namespace l4d::train
