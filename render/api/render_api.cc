// SPDX-License-Identifier: Apache-2.0
// The C entry points of the renderer.
#include <cmath>
#include <memory>

#include "l4d/experimental/sensitivity.h"
#include "libl4dcodec/base/c_api.h"
#include "libl4dcodec/scene/rendering.h"
#include "render/api/first_versions.h"
#include "render/api/read_camera.h"
#include "render/importance/measure.h"
#include "render/importance/sensitivity.h"
#include "render/renderer.h"
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

struct l4d_renderer {
  explicit l4d_renderer(const l4d_renderer_options& options) : renderer(options) {}
  l4d::render::Renderer renderer;
  mutable l4d::api::Busy busy;
};

struct l4d_sensitivity {
  explicit l4d_sensitivity(l4d::render::Sensitivity&& s) : sensitivity(std::move(s)) {}
  l4d::render::Sensitivity sensitivity;
};

namespace {

constexpr double kDefaultAgreement = 0.95;

// Runs body(renderer) for a call on the handle.
template <typename Body>
l4d_status call(l4d_renderer* handle, const char* bad, const Body& body) {
  return call_on(handle, bad, [&] { return body(handle->renderer); });
}

}  // namespace

l4d_status l4d_renderer_create(const l4d_renderer_options* options, l4d_renderer** out) {
  return keep_last(guard([&]() -> Status {
    if (const char* bad = required(out)) return l4d::invalid_argument(bad);
    if (const char* bad = optional(options)) return l4d::invalid_argument(bad);
    const l4d_renderer_options o = read_optional(options);
    if (o.backend > L4D_BACKEND_CUDA) return Status(L4D_ERR_FEATURE_UNSUPPORTED, "unknown backend");
    if (o.exponential > L4D_RENDER_EXP_FAST || o.threads > L4D_MAX_THREADS) {
      return l4d::invalid_argument("an option of the renderer is out of range");
    }
    *out = new l4d_renderer(o);
    return {};
  }));
}
void l4d_renderer_destroy(l4d_renderer* renderer) {
  if (l4d::api::may_destroy(renderer)) delete renderer;
}
l4d_status l4d_renderer_set_gaussians(l4d_renderer* renderer, const l4d_gaussians* gaussians,
                                      const l4d_timeline* timeline) {
  return call(renderer, required(gaussians, timeline),
              [&](auto& r) { return r.set_gaussians(read_struct(*gaussians), *timeline); });
}
l4d_status l4d_renderer_set_streams(l4d_renderer* renderer, l4d_decoder* const* decoders,
                                    const double* shifts, uint32_t count,
                                    const l4d_operating_point* point) {
  return call(renderer, required(decoders), [&](auto& r) -> Status {
    if (count == 0) return l4d::invalid_argument("count is 0");
    for (uint32_t k = 0; k < count; ++k) {
      if (decoders[k] == nullptr) return l4d::invalid_argument("a decoder is NULL");
      if (shifts != nullptr && !std::isfinite(shifts[k])) {
        return l4d::invalid_argument("shifts are finite");
      }
    }
    const l4d_operating_point all = {};
    const l4d_operating_point& shown = point == nullptr ? all : *point;
    if (shown.detail > L4D_DETAIL_BASE_COLOR) return l4d::invalid_argument("unknown detail");
    return r.set_streams(decoders, shifts, count, shown);
  });
}
l4d_status l4d_renderer_set_rendering(l4d_renderer* renderer, const l4d_rendering* rendering) {
  return call(renderer, optional(rendering), [&](l4d::render::Renderer& r) -> Status {
    if (rendering == nullptr) return r.set_rendering(nullptr);
    const l4d_rendering given = l4d::resolved(read_struct(*rendering));
    return r.set_rendering(&given);
  });
}

l4d_status l4d_renderer_set_background(l4d_renderer* renderer, const float* rgb) {
  return call(renderer, required(rgb), [&](auto& r) -> Status {
    L4D_RETURN_IF_ERROR(l4d::render::check_background(rgb));
    r.set_background(rgb);
    return {};
  });
}
l4d_status l4d_renderer_set_time(l4d_renderer* renderer, double time) {
  return call(renderer, nullptr, [&](auto& r) { return r.set_time(time); });
}
l4d_status l4d_renderer_render(l4d_renderer* renderer, const l4d_camera* camera,
                               const l4d_image* image) {
  return call(renderer, required(camera, image),
              [&](auto& r) { return r.render(read_camera(*camera), read_struct(*image)); });
}
l4d_status l4d_renderer_backward(l4d_renderer* renderer, const l4d_camera* camera,
                                 const float* rgb_gradient, l4d_gradients* gradients) {
  const char* const bad = required(camera, rgb_gradient, gradients);
  return call(renderer, bad, [&](auto& r) {
    l4d_gradients g = read_struct(*gradients);
    return r.backward(read_camera(*camera), rgb_gradient, &g);
  });
}
l4d_status l4d_renderer_get_stats(const l4d_renderer* renderer, l4d_render_stats* stats) {
  return call_on(renderer, required(stats), [&]() -> Status {
    l4d_render_stats s{};
    renderer->renderer.stats(&s);
    write_struct(s, stats);
    return {};
  });
}

l4d_status l4d_sensitivity_create(const l4d_sensitivity_options* options, uint64_t count,
                                  uint32_t sh_degree, l4d_sensitivity** out) {
  return keep_last(guard([&]() -> Status {
    if (const char* bad = required(out)) return l4d::invalid_argument(bad);
    if (const char* bad = optional(options)) return l4d::invalid_argument(bad);
    const l4d_sensitivity_options o = read_optional(options);
    if (sh_degree > 3 || count > UINT32_MAX || o.metric > L4D_SENSITIVITY_GAUSS_NEWTON) {
      return l4d::invalid_argument("sh_degree, count or metric is out of range");
    }
    *out = new l4d_sensitivity(l4d::render::Sensitivity(o, static_cast<size_t>(count), sh_degree));
    return {};
  }));
}
void l4d_sensitivity_destroy(l4d_sensitivity* sensitivity) { delete sensitivity; }
l4d_status l4d_sensitivity_add_view(l4d_sensitivity* sensitivity, l4d_renderer* renderer,
                                    const l4d_camera* camera, int visibility_only) {
  return call(renderer, required(sensitivity, camera), [&](auto& r) {
    return sensitivity->sensitivity.add_view(r, read_camera(*camera), visibility_only != 0);
  });
}
l4d_status l4d_sensitivity_get_weights(const l4d_sensitivity* sensitivity, uint32_t which,
                                       float* out, uint64_t count) {
  return keep_last(guard([&]() -> Status {
    if (const char* bad = required(sensitivity, out)) return l4d::invalid_argument(bad);
    if (which >= L4D_WEIGHT_COUNT || count != sensitivity->sensitivity.count()) {
      return l4d::invalid_argument("no such weight, or another number of Gaussians");
    }
    return sensitivity->sensitivity.weights(which, out);
  }));
}

l4d_status l4d_measure_importance(l4d_renderer* renderer, const l4d_camera* cameras,
                                  uint32_t num_cameras, const l4d_view* views, uint64_t num_views,
                                  const l4d_measure_options* options, float* const* weights,
                                  uint64_t count, l4d_measure_report* report) {
  const char* bad = required(views, weights);
  if (bad == nullptr && cameras == nullptr) bad = "a required pointer is NULL";
  if (bad == nullptr) bad = optional(options);
  if (bad == nullptr) bad = optional(report);
  if (bad == nullptr && options != nullptr && options->group != nullptr) {
    bad = optional(options->group);
  }
  return call(renderer, bad, [&](auto& r) -> Status {
    l4d_measure_options o = read_optional(options);
    if (o.metric > L4D_SENSITIVITY_GAUSS_NEWTON || !(o.max_share >= 0) || !(o.agreement >= 0)) {
      return l4d::invalid_argument("metric or another option is out of range");
    }
    if (o.max_share == 0) o.max_share = 1;
    if (o.agreement == 0) o.agreement = kDefaultAgreement;
    l4d_process_group group;
    if (o.group != nullptr) {
      group = read_struct(*o.group);
      if (group.count == 0) group.count = 1;
      if (group.rank >= group.count || (group.count > 1 && group.sum == nullptr)) {
        return l4d::invalid_argument("a rank must be below their number, and their sum a function");
      }
      o.group = &group;
    }
    std::vector<l4d_camera> own;
    if (const char* wrong = read_array(cameras, num_cameras, &own)) {
      return l4d::invalid_argument(wrong);
    }
    for (l4d_camera& camera : own) camera = read_camera(camera);
    if (r.has_scene() && count != r.scene().count()) {
      return l4d::invalid_argument("count is not that of the scene");
    }
    l4d_measure_report result{};
    std::unique_ptr<l4d::render::Sensitivity> measured;
    L4D_RETURN_IF_ERROR(l4d::render::measure(
        r, own.data(), num_cameras, views, static_cast<size_t>(num_views), o, &result, &measured));
    for (uint32_t which = 0; which < L4D_WEIGHT_COUNT; ++which) {
      if (weights[which] != nullptr) {
        L4D_RETURN_IF_ERROR(measured->weights(which, weights[which]));
      }
    }
    if (report != nullptr) write_struct(result, report);
    return {};
  });
}
