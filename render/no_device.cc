// SPDX-License-Identifier: Apache-2.0
// In builds without device code.
#include "render/cuda/device_renderer.h"

namespace l4d::render {

Status make_device_renderer(const DeviceRendererOptions&, std::unique_ptr<DeviceRenderer>*) {
  return Status(L4D_ERR_FEATURE_UNSUPPORTED,
                "this build has no device code: use another backend, or build with L4D_CUDA=ON");
}

}  // namespace l4d::render
