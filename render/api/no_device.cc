// SPDX-License-Identifier: Apache-2.0
// In builds without device code.
#include "render/cuda/player/device_player.h"
#include "render/cuda/scene/device_live.h"
#include "render/cuda/scene/device_renderer.h"

namespace l4d::render {

Status make_device_renderer(const DeviceRendererOptions&, std::unique_ptr<DeviceRenderer>*) {
  return Status(L4D_ERR_FEATURE_UNSUPPORTED,
                "this build has no device code: use another backend, or build with L4D_CUDA=ON");
}

Status make_device_live(int, std::unique_ptr<DeviceLive>*) {
  return Status(L4D_ERR_FEATURE_UNSUPPORTED,
                "this build has no device code: build with L4D_CUDA=ON");
}

Status make_device_player(const l4d_cuda_player_options&, std::unique_ptr<DevicePlayer>*) {
  return Status(L4D_ERR_FEATURE_UNSUPPORTED,
                "this build has no device code: build with L4D_CUDA=ON");
}

}  // namespace l4d::render
