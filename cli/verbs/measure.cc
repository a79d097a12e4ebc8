// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <memory>
#include <thread>

#include "cli/command/progress.h"
#include "cli/command/values.h"
#include "cli/input/rendering.h"
#include "cli/text/units.h"
#include "cli/verbs/importance.h"
#include "eval/views/importance.h"
#include "l4d/cuda.h"

namespace l4d::cli {
namespace {

l4d_measure_options options_of(const MeasureArguments& a, size_t num_views) {
  a.check();
  l4d_measure_options options =
      eval::measure_options(a.all_views ? num_views : a.most_views, num_views, a.seed);
  if (a.metric != "gauss-newton") options.metric = L4D_SENSITIVITY_SUM;
  if (!a.agreement.empty()) options.agreement = parse_number(a.agreement, "--agreement");
  options.visibility_all = a.visibility == "all" ? 1 : 0;
  options.skip_visibility = a.visibility == "none" ? 1 : 0;
  if (!a.max_share.empty()) options.max_share = parse_number(a.max_share, "--max-share");
  return options;
}

}  // namespace

Importance measure_importance(Context& context, const std::string& verb, const io::Scene& scene,
                              const eval::CameraViews& all, const MeasureArguments& arguments) {
  l4d_measure_options options = options_of(arguments, all.views.size());
  options.group = arguments.alone ? nullptr : context.group().handle();
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
  // Sums in both halves of the views, what one view gives, and weights (l4d_measure_importance).
  const uint64_t numbers = options.metric == L4D_SENSITIVITY_GAUSS_NEWTON ? 9 : 35;
  const std::shared_ptr<void> sums = io::hold(
      context.budget().holder(),
      scene.count() * (2 * numbers * sizeof(double) + 192) + all.views.size() * sizeof(l4d_view),
      "the importance of Gaussians");
  Progress progress(context, verb);
  options.progress = &Progress::callback;
  options.progress_user = &progress;
  Importance result;
  static_cast<eval::MeasuredImportance&>(result) =
      eval::measure_importance(rendering, scene, all, options);
  return result;
}

}  // namespace l4d::cli
