// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "l4d/render.h"
#include "libl4dcodec/base/status.h"

namespace l4d::render {

// INVALID_ARGUMENT where the camera is none.
Status check_camera(const l4d_camera& camera);

}  // namespace l4d::render
