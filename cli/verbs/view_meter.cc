// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs/view_meter.h"

#include <optional>
#include <utility>

#include "cli/command/progress.h"
#include "cli/input/rendering.h"
#include "cli/text/units.h"
#include "eval/image/fidelity_meter.h"

namespace l4d::cli {
namespace {

eval::CameraViews views_of(Context& context, const io::Scene& scene,
                           const CameraArguments& cameras) {
  eval::CameraViews views = choose_views(context, cameras, "test", scene.timeline, [&] {
    return eval::instant_of(scene, eval::middle_of(scene.timeline));
  });
  const bool chosen = !cameras.frames.empty() || !cameras.ids.empty();
  const size_t all = views.views.size();
  if (!chosen) views = eval::spread_views(std::move(views), eval::kMeterViews);
  if (views.views.size() < all) {
    context.note(
        format("the target is measured in %zu of %zu views, spread evenly; --frames or "
               "--ids choose others",
               views.views.size(), all));
  }
  return views;
}

}  // namespace

struct ViewMeter::Parts {
  Context& context;
  const eval::Target& target;
  std::string name;
  std::optional<eval::RenderedScene> original;
  std::optional<eval::FidelityMeter> meter;
};

ViewMeter::ViewMeter(Context& context, const eval::Target& target, const std::string& name,
                     const io::Scene& scene, const CameraArguments& cameras)
    : parts_(new Parts{context, target, name, {}, {}}) {
  eval::CameraViews views = views_of(context, scene, cameras);
  Progress progress(context, "encode", "original");
  parts_->original.emplace(rendering_of(context), &scene, name);
  eval::MeterOptions options;
  options.max_render_bytes = context.render_memory(options.max_render_bytes);
  options.holder = context.budget().holder();
  options.captured = target.kind == eval::Target::Kind::kPsnrLoss;
  if (options.captured) check_captured(views);
  parts_->meter.emplace(*parts_->original, std::move(views), options, progress);
}

ViewMeter::~ViewMeter() = default;

size_t ViewMeter::num_views() const { return parts_->meter->num_views(); }

double ViewMeter::of(const eval::Encoding& encoding, eval::Observer& observer) const {
  eval::RenderedScene coded(rendering_of(parts_->context),
                            eval::StreamBytes{encoding.stream.data(), encoding.stream.size()},
                            parts_->name);
  return parts_->target.kind == eval::Target::Kind::kPsnrLoss
             ? parts_->meter->psnr_loss(coded, observer)
             : parts_->meter->fidelity(coded, observer).psnr;
}

}  // namespace l4d::cli
