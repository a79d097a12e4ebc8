// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs/compare_renders.h"

#include "cli/command/progress.h"
#include "cli/input/rendering.h"
#include "cli/text/units.h"
#include "cli/verbs/image_text.h"
#include "eval/image/image_comparison.h"

namespace l4d::cli {

RendersCompared compare_renders(Context& context, const Input& input_a, const Input& input_b,
                                const ImportArguments& import, const CameraArguments& cameras,
                                const RenderOptions& options,
                                const std::function<void(const Side& a, const Side& b)>& opened) {
  eval::RenderedScene a = render_input(context, input_a, import, "fast", 2);
  eval::RenderedScene b = render_input(context, input_b, import, "fast", 2);
  opened({a.timeline(), a.count()}, {b.timeline(), b.count()});
  const eval::CameraViews views = choose_views(context, cameras, "test", a.timeline(), [&] {
    return about(a.name(), [&] { return a.instant(eval::middle_of(a.timeline())); });
  });
  if (options.images) check_captured(views);
  const eval::ImageComparison comparison = [&] {
    Progress progress(context, "compare");
    return eval::compare_images(a, b, views, options.images, options.lpips, context.options.threads,
                                progress, options.display);
  }();
  if (options.picture != nullptr) {
    const io::View& worst = comparison.views[comparison.worst()].view;
    const double fidelity = eval::capped_psnr(comparison.views[comparison.worst()].fidelity.mse);
    const io::Image images = eval::side_by_side(a, b, views, worst, options.gain);
    io::write_png(options.picture->path(),
                  io::captioned(images, {"original, " + format_bytes(input_a.bytes()),
                                         "decoded, " + format_bytes(input_b.bytes()) +
                                             format(", %.1f dB", fidelity),
                                         "difference x " + format_number(options.gain)}));
    options.picture->finish();
  }
  return {image_json(comparison, options.per_view), image_text(comparison, options.per_view),
          comparison.summary(&eval::ViewFidelity::fidelity).psnr,
          options.display != nullptr ? comparison.min_jod() : 0};
}

}  // namespace l4d::cli
