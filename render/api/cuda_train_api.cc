// SPDX-License-Identifier: Apache-2.0
// The C entry points of rendering for trainers.
#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "l4d/experimental/cuda_train.h"
#include "libl4dcodec/base/c_api.h"
#include "libl4dcodec/scene/layers.h"
#include "libl4dcodec/scene/sh.h"
#include "render/api/device.h"
#include "render/api/first_versions.h"
#include "render/api/read_camera.h"
#include "render/view/camera.h"
#include "render/view/view.h"

using l4d::invalid_argument;
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
using l4d::render::TrainableView;

struct l4d_cuda_trainable {
  l4d::render::TrainableScene trainable;
  mutable l4d::api::Busy busy;
};

namespace {

template <typename Body>
l4d_status call(l4d_cuda_trainable* handle, const char* bad, const Body& body) {
  return call_on(handle, bad, [&] { return on_device(handle->trainable, body); });
}

// Builds without device code call neither of these.
// *sh_stride: as given or, where that is 0, what follows from the degree.
[[maybe_unused]] Status check_scene(const l4d_gaussians& g, const l4d_timeline& timeline,
                                    uint32_t* sh_stride) {
  if (g.sh_degree > 3) return invalid_argument("sh_degree is above 3");
  if (g.count > 0 && !l4d::has_all_arrays(g)) {
    return invalid_argument("an attribute array is NULL");
  }
  if (!l4d::is_valid(timeline)) return invalid_argument(l4d::kTimelineRule);
  const uint32_t numbers = 3 * l4d::sh_terms(g.sh_degree);
  if (*sh_stride == 0) *sh_stride = (numbers + 3) / 4 * 4;
  if (*sh_stride % 4 != 0 || *sh_stride < numbers || *sh_stride > 1024) {
    return invalid_argument("sh_stride must be a multiple of 4 from 3 (D+1)^2 to 1024");
  }
  if (reinterpret_cast<uintptr_t>(g.sh) % 16 != 0) {
    return invalid_argument("sh is not aligned to 16 bytes");
  }
  return {};
}

[[maybe_unused]] Status read_view(const l4d_cuda_trainable_view& in, TrainableView* out) {
  if (const char* bad = required(in.camera)) return invalid_argument(bad);
  out->camera = read_camera(*in.camera);
  L4D_RETURN_IF_ERROR(l4d::render::check_camera(out->camera));
  if (std::isnan(in.time)) return invalid_argument("the time is not a number");
  L4D_RETURN_IF_ERROR(l4d::render::check_background(in.background));
  if (in.rgb == nullptr) return invalid_argument("rgb of a view is NULL");
  out->time = in.time;
  std::copy_n(in.background, 3, out->background);
  out->rgb = in.rgb;
  out->alpha = in.alpha;
  return {};
}

}  // namespace

l4d_status l4d_cuda_trainable_create(const l4d_cuda_renderer_options* options,
                                     l4d_cuda_trainable** out) {
  return keep_last(guard([&]() -> Status {
    if (const char* bad = required(out)) return invalid_argument(bad);
    if (const char* bad = optional(options)) return invalid_argument(bad);
    const l4d_cuda_renderer_options o = read_optional(options);
    if (o.sh_format != L4D_CUDA_SH_FLOAT32 || o.device > 4096 || o.time_passes > 1) {
      return invalid_argument("sh_format must be FLOAT32, device at most 4096, time_passes 0 or 1");
    }
    auto handle = std::make_unique<l4d_cuda_trainable>();
    const auto create = [&](auto& l) -> Status {
      L4D_RETURN_IF_ERROR(l.create(static_cast<int>(o.device)));
      return o.time_passes != 0 ? l.time_passes() : Status();
    };
    L4D_RETURN_IF_ERROR(on_device(handle->trainable, create));
    *out = handle.release();
    return {};
  }));
}
void l4d_cuda_trainable_destroy(l4d_cuda_trainable* trainable) {
  if (l4d::api::may_destroy(trainable)) delete trainable;
}
l4d_status l4d_cuda_trainable_set_scene(l4d_cuda_trainable* trainable,
                                        const l4d_gaussians* gaussians,
                                        const l4d_timeline* timeline,
                                        const l4d_cuda_trainable_rows* rows) {
  const char* bad = required(gaussians, timeline);
  return call(trainable, bad != nullptr ? bad : optional(rows), [&](auto& l) -> Status {
    const l4d_gaussians g = read_struct(*gaussians);
    l4d_cuda_trainable_rows r = rows == nullptr ? l4d_cuda_trainable_rows{} : read_struct(*rows);
    L4D_RETURN_IF_ERROR(check_scene(g, *timeline, &r.sh_stride));
    return l.set_scene(g, *timeline, r);
  });
}
l4d_status l4d_cuda_trainable_set_sh_degree(l4d_cuda_trainable* trainable, uint32_t degree) {
  return call(trainable, nullptr, [&](auto& l) { return l.set_sh_degree(degree); });
}
l4d_status l4d_cuda_trainable_refresh(l4d_cuda_trainable* trainable, void* stream) {
  return call(trainable, nullptr, [&](auto& l) { return l.refresh(stream); });
}
l4d_status l4d_cuda_trainable_reserve(l4d_cuda_trainable* trainable,
                                      const l4d_cuda_frame_capacity* capacity, uint32_t views) {
  return call(trainable, required(capacity), [&](auto& l) -> Status {
    const l4d_cuda_frame_capacity wanted = read_struct(*capacity);
    L4D_RETURN_IF_ERROR(l4d::render::check_image_size(wanted.width, wanted.height));
    if (views == 0 || views > L4D_CUDA_TRAINABLE_MAX_VIEWS) {
      return invalid_argument("views must be between 1 and 16");
    }
    return l.reserve(wanted, views);
  });
}
l4d_status l4d_cuda_trainable_forward(l4d_cuda_trainable* trainable,
                                      const l4d_cuda_trainable_view* views, uint32_t num_views,
                                      void* stream) {
  return call(trainable, required(views), [&](auto& l) -> Status {
    if (num_views == 0) return invalid_argument("num_views is 0");
    std::vector<l4d_cuda_trainable_view> given;
    if (const char* bad = read_array(views, num_views, &given)) {
      return invalid_argument(bad);
    }
    std::vector<TrainableView> checked(given.size());
    for (size_t v = 0; v < given.size(); ++v) {
      L4D_RETURN_IF_ERROR(read_view(given[v], &checked[v]));
    }
    return l.forward(checked, stream);
  });
}
l4d_status l4d_cuda_trainable_backward(l4d_cuda_trainable* trainable,
                                       const l4d_cuda_trainable_loss* losses, uint32_t num_views,
                                       const l4d_gradients* gradients,
                                       const l4d_cuda_trainable_statistics* statistics,
                                       void* stream) {
  const char* bad = required(losses, gradients);
  return call(trainable, bad != nullptr ? bad : optional(statistics), [&](auto& l) -> Status {
    std::vector<l4d_cuda_trainable_loss> given;
    if (const char* wrong = read_array(losses, num_views, &given)) {
      return invalid_argument(wrong);
    }
    for (const l4d_cuda_trainable_loss& loss : given) {
      if (loss.rgb_gradient == nullptr) return invalid_argument("rgb_gradient of a view is NULL");
    }
    const l4d_cuda_trainable_statistics s =
        statistics == nullptr ? l4d_cuda_trainable_statistics{} : read_struct(*statistics);
    return l.backward(given, read_struct(*gradients), s, stream);
  });
}
l4d_status l4d_cuda_trainable_copy_report(l4d_cuda_trainable* trainable, void* stream) {
  return call(trainable, nullptr, [&](auto& l) { return l.copy_report(stream); });
}
l4d_status l4d_cuda_trainable_get_report(l4d_cuda_trainable* trainable, uint32_t wait,
                                         l4d_cuda_trainable_report* report) {
  return call(trainable, required(report), [&](auto& l) -> Status {
    l4d_cuda_trainable_report out{};
    L4D_RETURN_IF_ERROR(l.get_report(wait != 0, &out));
    write_struct(out, report);
    return {};
  });
}
