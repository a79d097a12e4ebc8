// SPDX-License-Identifier: Apache-2.0
#include "render/renderer.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <string>

#include "libl4dcodec/base/threads.h"
#include "libl4dcodec/scene/rendering.h"
#include "render/cpu/fast/fast.h"
#include "render/cpu/reference.h"
#include "render/frame/project_gradient.h"
#include "render/frame/view_gradient.h"
#include "render/view/camera.h"

namespace l4d::render {
namespace {

constexpr size_t kProjectionGrain = 1024;
constexpr uint64_t kDefaultMemory = uint64_t{16} << 30;

Status slice_into(Scene& scene, double time, int threads, MemoryBudget& memory, Frame<float>* out) {
  return scene.slice(time, threads, memory, out);
}
Status slice_into(Scene& scene, double time, int, MemoryBudget& memory, Frame<double>* out) {
  return scene.slice(time, memory, out);
}

}  // namespace

#ifndef L4D_HAVE_CUDA
Status make_device_renderer(const DeviceRendererOptions&, std::unique_ptr<DeviceRenderer>*) {
  return Status(L4D_ERR_FEATURE_UNSUPPORTED,
                "this build has no device code: use another backend, or build with L4D_CUDA=ON");
}
#endif

Renderer::Renderer(const l4d_renderer_options& options)
    : threads_(static_cast<int>(options.threads)),
      cuda_(options.backend == L4D_BACKEND_CUDA),
      device_number_(options.device),
      stated_(default_rendering()),
      given_(stated_) {
  memory_.set_limit(options.max_memory_bytes == 0 ? kDefaultMemory : options.max_memory_bytes);
  if (cuda_) return;
  if (options.backend == L4D_BACKEND_REFERENCE) {
    double_.rasterizer = make_reference_rasterizer(memory_);
  } else {
    float_.rasterizer = make_fast_rasterizer(threads_, options.exponential == L4D_RENDER_EXP_FAST,
                                             memory_, options.cancel);
  }
}

Status Renderer::acquire_device() {
  if (device_ != nullptr) return {};
  L4D_RETURN_IF_ERROR(make_device_renderer({static_cast<int>(device_number_), false}, &device_));
  return device_->time_passes();
}

void Renderer::forget(bool with_scene) {
  with_path([&](auto& path) {
    path.rasterizer->forget();
    l4d::forget(memory_, &path.gradients.splat);
    l4d::forget(memory_, &path.gradients.coverage);
  });
  if (!with_scene) return;
  scene_.forget(memory_);
  streams_.restart();
  float_.frame.forget(memory_);
  double_.frame.forget(memory_);
}

template <typename Body>
Status Renderer::within_limit(bool with_scene, const Body& body) {
  Status status = body();
  if (cuda_ || status.code() != L4D_ERR_LIMIT_EXCEEDED) return status;
  forget(with_scene);
  return body();
}

Status Renderer::set_gaussians(const l4d_gaussians& gaussians, const l4d_timeline& timeline) {
  source_ = Source::kNone;
  has_time_ = false;
  streams_.restart();
  if (cuda_) {
    L4D_RETURN_IF_ERROR(acquire_device());
    L4D_RETURN_IF_ERROR(scene_.set(gaussians, timeline));
    L4D_RETURN_IF_ERROR(device_->set_gaussians(gaussians, timeline));
  } else {
    L4D_RETURN_IF_ERROR(
        within_limit(true, [&] { return scene_.prepare(gaussians, timeline, threads_, memory_); }));
  }
  stated_ = default_rendering();
  source_ = Source::kGaussians;
  return {};
}

Status Renderer::set_streams(l4d_decoder* const* decoders, const double* shifts, size_t count,
                             const l4d_operating_point& point) {
  for (size_t k = 0; k < count; ++k) {
    l4d_info info = L4D_INIT(l4d_info);
    const l4d_status status = l4d_decoder_get_info(decoders[k], &info);
    if (status != L4D_OK) return Status(status, "the decoder has no open stream");
  }
  l4d_rendering stated = default_rendering();
  l4d_decoder_get_rendering(decoders[0], &stated);
  if (!has_given_) L4D_RETURN_IF_ERROR(supports(stated));
  has_time_ = false;
  if (cuda_) L4D_RETURN_IF_ERROR(acquire_device());
  streams_.set(decoders, shifts, count, point);
  stated_ = stated;
  source_ = Source::kStreams;
  return {};
}

Status Renderer::supports(const l4d_rendering& rendering) const {
  if (!cuda_ || is_default(rendering)) return {};
  return Status(L4D_ERR_FEATURE_UNSUPPORTED,
                "device code draws by the numbers of 3D Gaussian splatting alone, and the scene "
                "states others: use a CPU backend");
}

Status Renderer::set_rendering(const l4d_rendering* rendering) {
  const l4d_rendering next = rendering == nullptr ? stated_ : *rendering;
  if (!is_valid(next)) return invalid_argument("a number of the rendering is out of range");
  L4D_RETURN_IF_ERROR(supports(next));
  has_given_ = rendering != nullptr;
  if (has_given_) given_ = next;
  return {};
}

Status Renderer::slice(double time) {
  if (source_ == Source::kGaussians) {
    time_ = std::clamp(time, scene_.timeline().time_begin, scene_.time_end());
    if (cuda_) return {};  // a device slices as it renders
    return with_path(
        [&](auto& path) { return slice_into(scene_, time_, threads_, memory_, &path.frame); });
  }
  time_ = time;  // decoders clamp
  L4D_RETURN_IF_ERROR(streams_.slice(time, memory_, &float_.frame));
  if (double_.rasterizer != nullptr) return widen(float_.frame, memory_, &double_.frame);
  if (!cuda_) return {};
  const Frame<float>& f = float_.frame;
  HostSplats splats{f.count(), f.sh_degree, {}, {}, f.opacity.data(), f.sh.data()};
  for (size_t k = 0; k < 3; ++k) splats.position[k] = f.position[k].data();
  for (size_t k = 0; k < 6; ++k) splats.covariance[k] = f.covariance[k].data();
  return device_->set_splats(splats);
}

Status Renderer::set_time(double time) {
  if (source_ == Source::kNone) {
    return Status(L4D_ERR_INVALID_STATE, "no scene: call set_gaussians or set_streams first");
  }
  if (std::isnan(time)) return invalid_argument("the time is not a number");
  has_time_ = false;
  const auto begin = std::chrono::steady_clock::now();
  L4D_RETURN_IF_ERROR(within_limit(false, [&] { return slice(time); }));
  device_visible_ = 0;
  stats_ = Stats();
  stats_.seconds[L4D_RENDER_PASS_SLICE] =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  has_time_ = true;
  return {};
}

Status Renderer::ready(const l4d_camera& camera) const {
  if (!has_time_) return Status(L4D_ERR_INVALID_STATE, "no instant: call set_time first");
  L4D_RETURN_IF_ERROR(supports(rendering()));
  return check_camera(camera);
}

void Renderer::begin_view() {
  const double slice = stats_.seconds[L4D_RENDER_PASS_SLICE];
  stats_ = Stats();
  stats_.seconds[L4D_RENDER_PASS_SLICE] = slice;
}

void Renderer::keep(const DeviceFrameStats& stats) {
  device_visible_ = stats.visible;
  stats_.projected = stats.projected;
  stats_.instances = stats.instances;
  for (int k = 0; k < L4D_RENDER_PASS_COUNT; ++k) {
    // Slicing on the device is part of the view; what set_time did stays.
    stats_.seconds[k] = (k == L4D_RENDER_PASS_SLICE ? stats_.seconds[k] : 0) + stats.seconds[k];
  }
}

Status Renderer::render(const l4d_camera& camera, const l4d_image& image) {
  L4D_RETURN_IF_ERROR(ready(camera));
  begin_view();
  if (cuda_) {
    DeviceFrameStats stats;
    L4D_RETURN_IF_ERROR(device_->render(time_, camera, background_, image, &stats));
    keep(stats);
    return {};
  }
  return with_path([&](auto& path) {
    using T = typename std::decay_t<decltype(path.frame.opacity)>::value_type;
    return within_limit(false, [&] {
      return path.rasterizer->forward(path.frame, make_view<T>(camera, rendering()), background_,
                                      image.rgb, image.alpha, &stats_);
    });
  });
}

template <typename T>
Instant<T> Renderer::instant() const {
  const l4d_gaussians& g = scene_.gaussians();
  // Times count from the instant itself: that is where differences matter.
  return {T(0), static_cast<T>(scene_.timeline().time_begin - time_),
          static_cast<T>(scene_.time_end() - time_), (g.flags & L4D_POSITION_AT_MEAN_TIME) != 0,
          (g.flags & L4D_OPACITY_LOGIT) != 0};
}

template <typename T>
Gaussian4D<T> Renderer::attributes(size_t id) const {
  return read_gaussian<T>(scene_.gaussians(), id, time_);
}

namespace {
// From derivatives by a splat to those by the slice. In double, and from the slice in double:
// behind a long splat stand small differences of large numbers, which binary32 does not hold.
template <typename T>
bool back_to_slice(const View<double>& view, const Slice3D<double>& slice, uint32_t sh_degree,
                   const float* sh, const SplatGradient2D<T>& by_splat,
                   SplatGradient3D<double>* out, double* sh_gradient) {
  Projection<double> projection;
  if (!project_geometry(view, slice.position, slice.covariance, &projection)) return false;
  SplatGradient2D<double> g;
  for (size_t k = 0; k < 2; ++k) g.mean[k] = static_cast<double>(by_splat.mean[k]);
  for (size_t k = 0; k < 3; ++k) g.conic[k] = static_cast<double>(by_splat.conic[k]);
  for (size_t k = 0; k < 3; ++k) g.color[k] = static_cast<double>(by_splat.color[k]);
  g.opacity = static_cast<double>(by_splat.opacity);
  geometry_gradient(view, slice.covariance, projection, g, slice.opacity, out);
  shade_gradient(view, sh_degree, slice.position, sh, g.color, true, out->direction, sh_gradient);
  for (size_t k = 0; k < 3; ++k) out->position[k] += out->direction[k];
  return true;
}
}  // namespace

template <typename T>
void Renderer::add_gradients(Path<T>& path, const View<double>& view, l4d_gradients* out) {
  const Instant<double> at = instant<double>();
  const size_t sh_dim = size_t{3} * sh_terms(path.frame.sh_degree);
  const auto add = [](float* to, const double* from, size_t n) {
    for (size_t k = 0; k < n && to != nullptr; ++k) to[k] += static_cast<float>(from[k]);
  };
  const auto of = [](float* base, size_t i, size_t n) {
    return base == nullptr ? nullptr : base + n * i;
  };
  // By chunks of Gaussians, so that sums do not depend on threads.
  using ViewSums = std::array<double, kViewNumbers>;
  std::vector<ViewSums> by_view(out->view == nullptr ? 0
                                                     : path.frame.count() / kProjectionGrain + 1);
  parallel_for(threads_, path.frame.count(), kProjectionGrain, [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) {
      if (!(path.gradients.coverage[i] > 0)) continue;
      SplatGradient3D<double> by_slice;
      double sh[3 * kMaxShTerms] = {};
      const size_t id = path.frame.id[i];
      const Gaussian4D<double> gaussian = attributes<double>(id);
      const Slice3D<double> slice = slice_at(gaussian, at);
      if (!back_to_slice(view, slice, path.frame.sh_degree, path.frame.sh[i],
                         path.gradients.splat[i], &by_slice, out->sh != nullptr ? sh : nullptr)) {
        continue;
      }
      const Gradient4D<double> g = slice_gradient(gaussian, at, by_slice);
      add(of(out->position, id, 3), g.position, 3);
      add(of(out->mean_t, id, 1), &g.mean_t, 1);
      add(of(out->log_scale, id, 4), g.log_scale, 4);
      add(of(out->rotor, id, 8), g.rotor, 8);
      add(of(out->opacity, id, 1), &g.opacity, 1);
      add(of(out->sh, id, sh_dim), sh, sh_dim);
      if (out->view == nullptr) continue;
      ViewSums own{};
      add_view_gradient(view, slice.position, slice.covariance, by_slice, g.time, own.data());
      if (!std::all_of(own.begin(), own.end(), [](double v) { return std::isfinite(v); })) continue;
      ViewSums& sums = by_view[begin / kProjectionGrain];
      for (size_t k = 0; k < sums.size(); ++k) sums[k] += own[k];
    }
  });
  for (const ViewSums& sums : by_view) {
    for (size_t k = 0; k < sums.size(); ++k) out->view[k] += sums[k];
  }
}

template <typename T>
void Renderer::add_light_gradients(Path<T>& path, const View<double>& view, l4d_gradients* out) {
  const Instant<double> at = instant<double>();
  const uint32_t degree = path.frame.sh_degree;
  const size_t sh_dim = size_t{3} * sh_terms(degree);
  parallel_for(threads_, path.frame.count(), kProjectionGrain, [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) {
      if (!(path.gradients.coverage[i] > 0)) continue;
      const SplatGradient2D<T>& by_splat = path.gradients.splat[i];
      const size_t id = path.frame.id[i];
      const Gaussian4D<double> gaussian = attributes<double>(id);
      // The base colour is the same from everywhere.
      const bool needs_slice = view.rules.compensates || (out->sh != nullptr && degree > 0);
      const Slice3D<double> slice = needs_slice ? slice_at(gaussian, at) : Slice3D<double>{};
      if (out->opacity != nullptr) {
        double by_opacity = static_cast<double>(by_splat.opacity);
        if (view.rules.compensates) {
          Projection<double> projection;
          if (!project_geometry(view, slice.position, slice.covariance, &projection)) continue;
          by_opacity *= compensation(view, projection);
        }
        out->opacity[id] += static_cast<float>(opacity_gradient(gaussian, at, by_opacity));
      }
      if (out->sh != nullptr) {
        double color[3], unused[3] = {}, sh[3 * kMaxShTerms];
        for (size_t c = 0; c < 3; ++c) color[c] = static_cast<double>(by_splat.color[c]);
        shade_gradient(view, degree, slice.position, path.frame.sh[i], color, true, unused, sh);
        for (size_t k = 0; k < sh_dim; ++k) out->sh[sh_dim * id + k] += static_cast<float>(sh[k]);
      }
    }
  });
}

Status Renderer::backward(const l4d_camera& camera, const float* rgb_gradient,
                          l4d_gradients* gradients) {
  L4D_RETURN_IF_ERROR(ready(camera));
  if (source_ != Source::kGaussians) {
    return Status(L4D_ERR_INVALID_STATE, "gradients need the scene's Gaussians: set_gaussians");
  }
  if (gradients->count != scene_.count()) {
    return invalid_argument("gradients.count is not the scene's");
  }
  begin_view();
  if (cuda_) {
    DeviceFrameStats stats;
    L4D_RETURN_IF_ERROR(
        device_->backward(time_, camera, background_, rgb_gradient, gradients, &stats));
    keep(stats);
    return {};
  }
  BackwardInput input;
  input.rgb_gradient = rgb_gradient;
  return with_path([&](auto& path) -> Status {
    using T = typename std::decay_t<decltype(path.frame.opacity)>::value_type;
    const View<T> view = make_view<T>(camera, rendering());
    L4D_RETURN_IF_ERROR(
        path.rasterizer->backward(path.frame, view, background_, input, &path.gradients, &stats_));
    const View<double> exact = make_view<double>(camera, rendering());
    if (gradients->position == nullptr && gradients->mean_t == nullptr &&
        gradients->log_scale == nullptr && gradients->rotor == nullptr &&
        gradients->view == nullptr) {
      add_light_gradients(path, exact, gradients);
    } else {
      add_gradients(path, exact, gradients);
    }
    return {};
  });
}

template <typename T>
void Renderer::collect(Path<T>& path, const View<double>& view, const ImportanceInput& input,
                       std::vector<Importance>* out) {
  const Instant<double> at = instant<double>();
  Instant<double> derived = at;
  derived.logit = false;
  if (input.as_coded) derived.at_mean_time = false;
  const std::vector<T>& coverage = path.gradients.coverage;
  out->resize(path.frame.count());
  parallel_for(threads_, path.frame.count(), kProjectionGrain, [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) {
      Importance& item = (*out)[i];
      item.id = path.frame.id[i];
      item.coverage = static_cast<float>(coverage[i]);
      if (input.seen != nullptr || !(coverage[i] > 0)) continue;
      SplatGradient3D<double> by_slice;
      const SplatGradient2D<T>& by_splat = path.gradients.splat[i];
      Gaussian4D<double> gaussian = attributes<double>(item.id);
      const Slice3D<double> slice = slice_at(gaussian, at);
      if (!back_to_slice(view, slice, path.frame.sh_degree, path.frame.sh[i], by_splat, &by_slice,
                         nullptr)) {
        by_slice = {};
      }
      double direction[3];
      view_direction(view, slice.position, direction);
      for (size_t k = 0; k < 3; ++k) item.direction[k] = static_cast<float>(direction[k]);
      // The backward pass asks for the instant of the position, not for the position.
      gaussian.opacity = linear_opacity(gaussian, at);
      if (input.as_coded) normalize_rotor(gaussian.rotor, gaussian.rotor);
      const Gradient4D<double> g = slice_gradient(gaussian, derived, by_slice);
      const auto narrow = [](const auto& from, auto& to) {
        std::transform(std::begin(from), std::end(from), std::begin(to),
                       [](auto v) { return static_cast<float>(v); });
      };
      narrow(by_splat.color, item.color);
      narrow(g.position, item.gradient.position);
      narrow(g.log_scale, item.gradient.log_scale);
      narrow(g.rotor, item.gradient.rotor);
      item.gradient.mean_t = static_cast<float>(g.mean_t);
      item.gradient.opacity = static_cast<float>(g.opacity);
    }
  });
}

Status Renderer::importance(const l4d_camera& camera, const ImportanceInput& input,
                            std::vector<Importance>* out) {
  L4D_RETURN_IF_ERROR(ready(camera));
  begin_view();
  BackwardInput back;
  back.signs = input.signs;
  back.geometry = input.seen == nullptr;
  back.seen = input.seen;
  return with_path([&](auto& path) -> Status {
    using T = typename std::decay_t<decltype(path.frame.opacity)>::value_type;
    const View<T> view = make_view<T>(camera, rendering());
    L4D_RETURN_IF_ERROR(
        path.rasterizer->backward(path.frame, view, background_, back, &path.gradients, &stats_));
    collect(path, make_view<double>(camera, rendering()), input, out);
    return {};
  });
}

Status Renderer::make_importance(uint32_t metric, bool sum_visible_only,
                                 std::unique_ptr<DeviceImportance>* out) {
  if (source_ != Source::kGaussians || device_ == nullptr) {
    return Status(L4D_ERR_INVALID_STATE, "importance needs the scene's Gaussians: set_gaussians");
  }
  return device_->make_importance(metric, sum_visible_only, out);
}

Status Renderer::add_importance(const l4d_camera& camera, bool squared, uint64_t signs,
                                bool visibility_only, DeviceImportance* sums, bool wait) {
  L4D_RETURN_IF_ERROR(ready(camera));
  begin_view();
  DeviceFrameStats stats;
  L4D_RETURN_IF_ERROR(device_->add_importance(time_, camera, squared, signs, visibility_only, sums,
                                              wait ? &stats : nullptr));
  keep(stats);
  return {};
}

Status Renderer::finish_importance() {
  return device_ == nullptr ? Status() : device_->finish_importance();
}

void Renderer::stats(l4d_render_stats* out) const {
  const size_t sliced =
      double_.rasterizer != nullptr ? double_.frame.count() : float_.frame.count();
  out->visible = cuda_ ? device_visible_ : sliced;
  out->projected = stats_.projected;
  out->instances = stats_.instances;
  std::copy_n(stats_.seconds, L4D_RENDER_PASS_COUNT, out->seconds);
}

}  // namespace l4d::render
