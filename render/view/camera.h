// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "l4d/render.h"
#include "libl4dcodec/base/status.h"

namespace l4d::render {

// A camera as l4d_camera says it: near_plane and world_to_camera with their defaults in place of
// zeros.
l4d_camera resolved(l4d_camera camera);
// INVALID_ARGUMENT where the camera is none.
Status check_camera(const l4d_camera& camera);
// INVALID_ARGUMENT where an image is larger than images may be.
Status check_image_size(uint32_t width, uint32_t height);
// INVALID_ARGUMENT where a channel is not a finite number. rgb: [3]
Status check_background(const float* rgb);

}  // namespace l4d::render
