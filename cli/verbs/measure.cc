// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <thread>

#include "cli/rendering.h"
#include "cli/text/progress.h"
#include "cli/text/units.h"
#include "cli/verbs/importance.h"
#include "l4d/cuda.h"

namespace l4d::cli {
namespace {

l4d_measure_options options_of(const MeasureArguments& a) {
  a.check();
  l4d_measure_options options;
  l4d_measure_options_init(&options);
  if (a.metric == "gauss-newton") options.metric = L4D_SENSITIVITY_GAUSS_NEWTON;
  options.seed = a.seed;
  if (!a.agreement.empty()) options.agreement = parse_number(a.agreement, "--agreement");
  options.visibility_all = a.visibility == "all" ? 1 : 0;
  options.skip_visibility = a.visibility == "none" ? 1 : 0;
  if (a.all_views) options.agreement = 2;  // a correlation never gets there
  if (!a.max_share.empty()) options.max_share = parse_number(a.max_share, "--max-share");
  return options;
}

}  // namespace

Importance measure_importance(Context& context, const std::string& verb, const io::Scene& scene,
                              const eval::CameraViews& all, const MeasureArguments& arguments) {
  const Stopwatch watch;
  l4d_measure_options options = options_of(arguments);
  options.group = arguments.alone ? nullptr : context.group().handle();
  std::vector<l4d_camera> cameras;
  for (const io::Camera& camera : all.set.cameras) cameras.push_back(camera.camera);
  std::vector<l4d_view> views;
  for (const io::View& view : all.views) {
    views.push_back({view.time, static_cast<uint32_t>(view.camera), 0});
  }
  Importance result;
  l4d_measure_report_init(&result.report);
  l4d_renderer_options rendering = renderer_options(context);
  // Views cost a device little: there is no need to be sparing of them.
  if (arguments.agreement.empty() && !arguments.all_views &&
      rendering.backend == L4D_BACKEND_CUDA) {
    options.agreement = 0.99;
  }
  const ProcessGroup& group = context.group();
  uint32_t devices = 0;
  l4d_cuda_get_device_count(&devices);
  rendering.device = devices > 0 ? group.local_rank() % devices : 0;
  if (rendering.threads == 0 && group.local_count() > 1) {
    rendering.threads = std::max(1u, std::thread::hardware_concurrency() / group.local_count());
  }
  RendererHandle renderer(&rendering);
  const l4d_gaussians gaussians = scene.view();
  renderer.set_rendering(&scene.rendering);
  renderer.set_gaussians(gaussians, scene.timeline);
  l4d_sensitivity* measured = nullptr;
  {
    Progress progress(context, verb);
    renderer.check(l4d_measure_importance(
        renderer.get(), cameras.data(), static_cast<uint32_t>(cameras.size()), views.data(),
        views.size(), &options, &Progress::callback, &progress, &result.report, &measured));
  }
  const SensitivityHandle sensitivity(measured, scene.count());
  result.weights.count = scene.count();
  result.weights.gauss_newton = options.metric == L4D_SENSITIVITY_GAUSS_NEWTON;
  for (const auto& [which, column] : kWeightColumns)
    result.weights.*column = sensitivity.weights(which);
  result.seconds = watch.seconds();
  return result;
}

}  // namespace l4d::cli
