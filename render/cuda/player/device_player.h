// SPDX-License-Identifier: Apache-2.0
// A player of a stream on a CUDA device, told without a type of CUDA: what the functions of
// l4d/experimental/cuda_player.h call.
#pragma once

#include <memory>

#include "l4d/experimental/cuda_player.h"
#include "libl4dcodec/base/status.h"
#include "render/cuda/frame/image_target.h"

namespace l4d::render {

class BucketFeed;

class DevicePlayer {
 public:
  virtual ~DevicePlayer() = default;
  virtual Status reserve(uint32_t width, uint32_t height, uint64_t instances) = 0;
  virtual Status seek(double time) = 0;
  virtual Status render(double time, const l4d_camera& camera, const float* background,
                        const ImageTarget& image, void* stream) = 0;
  virtual Status stats(void* stream, l4d_cuda_frame_stats* out) = 0;
  virtual l4d_cuda_player_counters counters() = 0;
  // For the calls of a link.
  virtual BucketFeed& feed() = 0;
};

// Options have been checked. Fails with FEATURE_UNSUPPORTED in builds without device code, with
// L4D_ERR_DEVICE if there is no device that this build can use.
Status make_device_player(const l4d_cuda_player_options& options,
                          std::unique_ptr<DevicePlayer>* out);

}  // namespace l4d::render
