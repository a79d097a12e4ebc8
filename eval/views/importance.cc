// SPDX-License-Identifier: Apache-2.0
#include "eval/views/importance.h"

#include <chrono>
#include <vector>

#include "l4d/render.hpp"

namespace l4d::eval {

l4d_measure_options measure_options(size_t most_views, size_t num_views, uint64_t seed) {
  constexpr double kNever = 2;  // a correlation does not get there
  l4d_measure_options options = L4D_INIT(l4d_measure_options);
  options.metric = L4D_SENSITIVITY_GAUSS_NEWTON;
  options.seed = seed;
  if (most_views > 0) options.agreement = kNever;
  if (most_views > 0 && most_views < num_views) {
    options.max_share = static_cast<double>(most_views) / static_cast<double>(num_views);
  }
  return options;
}

MeasuredImportance measure_importance(const l4d_renderer_options& rendering, const io::Scene& scene,
                                      const CameraViews& views,
                                      const l4d_measure_options& options) {
  using Clock = std::chrono::steady_clock;
  const Clock::time_point begun = Clock::now();
  const std::vector<l4d_camera> cameras = views.pinholes();
  const std::vector<l4d_view> measured = views.numbered();
  RendererHandle renderer(&rendering);
  const l4d_gaussians gaussians = scene.view();
  renderer.set_rendering(&scene.rendering);
  renderer.set_gaussians(gaussians, scene.timeline);
  MeasuredImportance out;
  out.report = L4D_INIT(l4d_measure_report);
  out.weights.gauss_newton = options.metric == L4D_SENSITIVITY_GAUSS_NEWTON;
  const auto columns = out.weights.make_columns(scene.count());
  renderer.measure_importance(cameras, measured, &options, columns.data(), scene.count(),
                              &out.report);
  out.seconds = std::chrono::duration<double>(Clock::now() - begun).count();
  return out;
}

}  // namespace l4d::eval
