// SPDX-License-Identifier: Apache-2.0
// The classes of render/cuda that handles of the C API hold. A build without device code has none:
// their calls fail, and what these would do is not compiled.
#pragma once

#include "libl4dcodec/base/status.h"
#ifdef L4D_HAVE_CUDA
#include "render/cuda/player/player.h"
#include "render/cuda/scene/trainable_scene.h"
#endif

namespace l4d::render {

#ifdef L4D_HAVE_CUDA
template <typename Device, typename Body>
Status on_device(Device& device, const Body& body) {
  return body(device);
}
#else
struct NoDevice {
  template <typename... Options>
  explicit NoDevice(const Options&...) {}
};
using TrainableScene = NoDevice;
using Player = NoDevice;

template <typename Body>
Status on_device(NoDevice&, const Body&) {
  return Status(L4D_ERR_FEATURE_UNSUPPORTED,
                "this build has no device code: build with L4D_CUDA=ON");
}
#endif

}  // namespace l4d::render
