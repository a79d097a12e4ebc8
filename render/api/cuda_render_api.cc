// SPDX-License-Identifier: Apache-2.0
// The C entry points of device-resident rendering.
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include "l4d/experimental/cuda_render.h"
#include "l4d/experimental/packed.h"
#include "libl4dcodec/base/c_api.h"
#include "libl4dcodec/scene/layers.h"
#include "libl4dcodec/scene/prepare.h"
#include "render/api/first_versions.h"
#include "render/api/read_camera.h"
#include "render/cuda/scene/device_renderer.h"
#include "render/view/camera.h"

using l4d::Status;
using l4d::api::call_on;
using l4d::api::guard;
using l4d::api::keep_last;
using l4d::api::optional;
using l4d::api::read_array;
using l4d::api::read_camera;
using l4d::api::read_optional;
using l4d::api::read_struct;
using l4d::api::required;
using l4d::api::write_struct;

struct l4d_cuda_renderer {
  std::unique_ptr<l4d::render::DeviceRenderer> renderer;
  mutable l4d::api::Busy busy;
};

namespace {

template <typename Body>
l4d_status call(l4d_cuda_renderer* handle, const char* bad, const Body& body) {
  return call_on(handle, bad, [&] { return body(*handle->renderer); });
}

Status check_timeline(const l4d_timeline& timeline) {
  if (!l4d::is_valid(timeline)) return l4d::invalid_argument(l4d::kTimelineRule);
  return {};
}

Status check_gaussians(const l4d_gaussians& g) {
  if (g.sh_degree > 3) return l4d::invalid_argument("sh_degree is above 3");
  if (g.count > 0 && !l4d::has_all_arrays(g)) {
    return l4d::invalid_argument("an attribute array is NULL");
  }
  return {};
}

}  // namespace

l4d_status l4d_cuda_renderer_create(const l4d_cuda_renderer_options* options,
                                    l4d_cuda_renderer** out) {
  return keep_last(guard([&]() -> Status {
    if (const char* bad = required(out)) return l4d::invalid_argument(bad);
    if (const char* bad = optional(options)) return l4d::invalid_argument(bad);
    const l4d_cuda_renderer_options o = read_optional(options);
    if (o.sh_format > L4D_CUDA_SH_FLOAT16 || o.device > 4096 || o.time_passes > 1) {
      return l4d::invalid_argument("sh_format, device or time_passes is out of range");
    }
    auto handle = std::make_unique<l4d_cuda_renderer>();
    l4d::render::DeviceRendererOptions inner;
    inner.device = static_cast<int>(o.device);
    inner.half_sh = o.sh_format == L4D_CUDA_SH_FLOAT16;
    L4D_RETURN_IF_ERROR(l4d::render::make_device_renderer(inner, &handle->renderer));
    if (o.time_passes != 0) L4D_RETURN_IF_ERROR(handle->renderer->time_passes());
    *out = handle.release();
    return {};
  }));
}
void l4d_cuda_renderer_destroy(l4d_cuda_renderer* renderer) {
  if (l4d::api::may_destroy(renderer)) delete renderer;
}
l4d_status l4d_cuda_renderer_set_gaussians(l4d_cuda_renderer* renderer,
                                           const l4d_gaussians* gaussians,
                                           const l4d_timeline* timeline) {
  return call(renderer, required(gaussians, timeline), [&](auto& r) -> Status {
    const l4d_gaussians g = read_struct(*gaussians);
    L4D_RETURN_IF_ERROR(check_gaussians(g));
    L4D_RETURN_IF_ERROR(check_timeline(*timeline));
    return r.set_device_gaussians(g, *timeline);
  });
}
l4d_status l4d_cuda_renderer_reserve(l4d_cuda_renderer* renderer,
                                     const l4d_cuda_frame_capacity* capacity) {
  return call(renderer, required(capacity), [&](auto& r) -> Status {
    const l4d_cuda_frame_capacity wanted = read_struct(*capacity);
    L4D_RETURN_IF_ERROR(l4d::render::check_image_size(wanted.width, wanted.height));
    return r.reserve(wanted.width, wanted.height, wanted.visible, wanted.instances);
  });
}
l4d_status l4d_cuda_renderer_render(l4d_cuda_renderer* renderer, double time,
                                    const l4d_camera* camera, const l4d_cuda_image* image,
                                    void* stream) {
  return call(renderer, required(camera, image), [&](auto& r) -> Status {
    const l4d_camera c = read_camera(*camera);
    L4D_RETURN_IF_ERROR(l4d::render::check_camera(c));
    if (std::isnan(time)) return l4d::invalid_argument("the time is not a number");
    const l4d_cuda_image i = read_struct(*image);
    L4D_RETURN_IF_ERROR(l4d::render::check_background(i.background));
    return r.launch(time, c, i.background, {i.rgb, i.alpha, i.rgba8}, stream);
  });
}
l4d_status l4d_cuda_renderer_get_stats(l4d_cuda_renderer* renderer, void* stream,
                                       l4d_cuda_frame_stats* stats) {
  return call(renderer, required(stats), [&](auto& r) -> Status {
    l4d::render::DeviceFrameStats f;
    l4d_cuda_frame_stats out{};
    const Status status = r.stats(stream, &f, &out.required_visible, &out.required_instances);
    if (!status.ok() && status.code() != L4D_ERR_LIMIT_EXCEEDED) return status;
    out.visible = f.visible;
    out.projected = f.projected;
    out.instances = f.instances;
    std::copy_n(f.seconds, L4D_RENDER_PASS_COUNT, out.seconds);
    write_struct(out, stats);
    return status;
  });
}
