// SPDX-License-Identifier: Apache-2.0
// A scene that changes in every step on a CUDA device, told without a type of CUDA: what the
// functions of l4d/experimental/cuda_train.h call.
#pragma once

#include <memory>
#include <vector>

#include "l4d/experimental/cuda_train.h"
#include "libl4dcodec/base/status.h"
#include "render/view/view.h"

namespace l4d::render {

// A view that has been checked.
struct LiveView {
  l4d_camera camera;
  double time;
  float background[3];
  float* rgb;
  float* alpha;
};

class DeviceLive {
 public:
  virtual ~DeviceLive() = default;
  virtual Status set_scene(const l4d_gaussians& gaussians, const l4d_timeline& timeline,
                           const l4d_cuda_live_rows& rows) = 0;
  virtual Status set_sh_degree(uint32_t degree) = 0;
  virtual Status refresh(void* stream) = 0;
  virtual Status reserve(const l4d_cuda_frame_capacity& capacity, uint32_t views) = 0;
  virtual Status forward(const std::vector<LiveView>& views, void* stream) = 0;
  virtual Status backward(const std::vector<l4d_cuda_live_loss>& losses,
                          const l4d_gradients& gradients,
                          const l4d_cuda_live_statistics& statistics, void* stream) = 0;
  virtual Status copy_report(void* stream) = 0;
  virtual Status get_report(bool wait, l4d_cuda_live_report* out) = 0;
  virtual Status time_passes() = 0;
};

// Fails as make_device_renderer does.
Status make_device_live(int device, std::unique_ptr<DeviceLive>* out);

}  // namespace l4d::render
