// SPDX-License-Identifier: Apache-2.0
// Rendering on a CUDA device, told without a type of CUDA: what the ordinary renderer and the API
// of device-resident rendering call. Device arrays are plain pointers, streams are cudaStream_t as
// void*. This class and DeviceImportance are abstract because host code of builds without device
// code calls them, too: what is left to link there is one function.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

#include "l4d/experimental/cuda_render.h"
#include "libl4dcodec/base/status.h"
#include "render/cuda/frame/image_target.h"
#include "render/cuda/importance/device_importance.h"
#include "render/view/view.h"

namespace l4d::render {

// 3D Gaussians at an instant, in host memory.
struct HostSplats {
  size_t count;
  uint32_t sh_degree;
  const float* position[3];    // [count] each
  const float* covariance[6];  // [count] each, xx xy xz yy yz zz
  const float* opacity;        // [count]
  const float* const* sh;      // [count] of [(D+1)^2, 3]
};

class DeviceRenderer {
 public:
  virtual ~DeviceRenderer() = default;

  // ---- scenes in host memory, images in host memory; every call waits for its results ----
  // The scene has been checked. Its arrays are copied.
  virtual Status set_gaussians(const l4d_gaussians& gaussians, const l4d_timeline& timeline) = 0;
  virtual Status set_splats(const HostSplats& splats) = 0;
  virtual Status render(double time, const l4d_camera& camera, const float* background,
                        const l4d_image& image, DeviceFrameStats* stats) = 0;
  virtual Status backward(double time, const l4d_camera& camera, const float* background,
                          const float* rgb_gradient, l4d_gradients* gradients,
                          DeviceFrameStats* stats) = 0;
  // sum_visible_only: visibility-only views add up what they show of a Gaussian; else the first one
  // tells.
  virtual Status make_importance(uint32_t metric, bool sum_visible_only,
                                 std::unique_ptr<DeviceImportance>* out) = 0;
  // Adds a view: magnitudes of derivatives of the sum of all pixels, or, where `squared`, squares
  // of derivatives with random signs made from `signs`; or, where visibility_only, coverage alone.
  // figures: NULL does not wait for the view, which fails in a later call then. Sums, of which all
  // views take turns, and the scene must stay until finish_importance().
  virtual Status add_importance(double time, const l4d_camera& camera, bool squared, uint64_t signs,
                                bool visibility_only, DeviceImportance* sums,
                                DeviceFrameStats* stats) = 0;
  virtual Status finish_importance() = 0;

  // ---- device memory throughout; calls only launch unless they say otherwise ----
  // Arrays of `gaussians` are device pointers here. Waits.
  virtual Status set_device_gaussians(const l4d_gaussians& gaussians,
                                      const l4d_timeline& timeline) = 0;
  // Waits where it has to grow.
  virtual Status reserve(uint32_t width, uint32_t height, uint64_t visible, uint64_t instances) = 0;
  virtual Status launch(double time, const l4d_camera& camera, const float* background,
                        const ImageTarget& image, void* stream) = 0;
  // Of the last frame. Waits for it. Fails with LIMIT_EXCEEDED where the capacity did not suffice
  // for all of it; *required_visible and *required_instances then say how much is missing, and are
  // set in any case.
  virtual Status stats(void* stream, DeviceFrameStats* out, uint64_t* required_visible,
                       uint64_t* required_instances) = 0;
  virtual Status time_passes() = 0;
};

struct DeviceRendererOptions {
  int device = 0;
  bool half_sh = false;  // SH coefficients in binary16
};

// Fails with FEATURE_UNSUPPORTED in builds without device code, with L4D_ERR_DEVICE where there is
// no device that this build can use.
Status make_device_renderer(const DeviceRendererOptions& options,
                            std::unique_ptr<DeviceRenderer>* out);

}  // namespace l4d::render
