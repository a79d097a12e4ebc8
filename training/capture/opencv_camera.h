// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "io/camera/cameras.h"
#include "io/camera/read_cameras.h"

// Cameras as OpenCV has them, of whatever file. Wrong numbers throw by their place.
namespace l4d::train {

// The rotation by |r| around r (Rodrigues), [3, 3] row-major.
void rotation_of(const double* r, double* out);

// k: [3, 3] row-major.
void set_pinhole(const io::CameraPlace& place, const double* k, l4d_camera* camera);

// d: k1, k2, p1, p2, k3 to k6 as OpenCV writes them: 4, 5, 8, 12 or 14 numbers.
void set_lens(const io::CameraPlace& place, std::vector<double> d, io::Camera* camera);

// World to camera. rotation: [3, 3] row-major.
void set_extrinsics(const double* rotation, const double* translation, l4d_camera* camera);

}  // namespace l4d::train
