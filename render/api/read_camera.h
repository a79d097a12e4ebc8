// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "libl4dcodec/base/c_api.h"
#include "render/view/camera.h"

namespace l4d::api {

// A camera of a caller, with the defaults of fields that are 0.
inline l4d_camera read_camera(const l4d_camera& camera) {
  return render::resolved(read_struct(camera));
}

}  // namespace l4d::api
