// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs/view_meter.h"

#include <optional>
#include <utility>

#include "cli/command/progress.h"
#include "cli/input/rendering.h"
#include "cli/text/units.h"
#include "eval/image/fidelity_meter.h"
#include "eval/image/image_comparison.h"

namespace l4d::cli {
namespace {

// Of JOD, whose videos take all their frames.
constexpr size_t kJodCameras = 4, kJodFrames = 30;

eval::CameraViews views_of(Context& context, const eval::Target& target, const io::Scene& scene,
                           const CameraArguments& cameras) {
  eval::CameraViews views = choose_views(context, cameras, "test", scene.timeline, [&] {
    return eval::instant_of(scene, eval::middle_of(scene.timeline));
  });
  const bool chosen = !cameras.frames.empty() || !cameras.ids.empty();
  const size_t all = views.views.size();
  const bool takes_videos = target.kind == eval::Target::Kind::kJod;
  if (!chosen) {
    views = takes_videos ? eval::short_videos(std::move(views), kJodCameras, kJodFrames)
                         : eval::spread_views(std::move(views), eval::kMeterViews);
  }
  if (views.views.size() < all) {
    context.note(format(
        "the target is measured in %zu of %zu views, %s; --frames or --ids choose "
        "others",
        views.views.size(), all, takes_videos ? "the middle of a few videos" : "spread evenly"));
  }
  return views;
}

}  // namespace

struct ViewMeter::Parts {
  Context& context;
  const eval::Target& target;
  std::string name;
  std::optional<eval::RenderedScene> original;
  eval::CameraViews videos;  // of JOD
  std::optional<eval::FidelityMeter> meter;
};

ViewMeter::ViewMeter(Context& context, const eval::Target& target, const std::string& name,
                     const io::Scene& scene, const CameraArguments& cameras)
    : parts_(new Parts{context, target, name, {}, {}, {}}) {
  eval::CameraViews views = views_of(context, target, scene, cameras);
  Progress progress(context, "encode", "original");
  parts_->original.emplace(rendering_of(context), &scene, name);
  if (target.kind == eval::Target::Kind::kJod) {
    parts_->videos = std::move(views);
    return;
  }
  eval::MeterOptions options;
  options.max_render_bytes = context.render_memory(options.max_render_bytes);
  options.holder = context.budget().holder();
  options.captured = target.kind == eval::Target::Kind::kPsnrLoss;
  if (options.captured) check_captured(views);
  parts_->meter.emplace(*parts_->original, std::move(views), options, progress);
}

ViewMeter::~ViewMeter() = default;

size_t ViewMeter::num_views() const {
  return parts_->meter ? parts_->meter->num_views() : parts_->videos.views.size();
}

double ViewMeter::of(const eval::Encoding& encoding, eval::Observer& observer) const {
  eval::RenderedScene coded(rendering_of(parts_->context),
                            eval::StreamBytes{encoding.stream.data(), encoding.stream.size()},
                            parts_->name);
  if (!parts_->meter) {
    return eval::compare_images(*parts_->original, coded, parts_->videos, false, nullptr,
                                parts_->context.options.threads, observer, parts_->target.display)
        .min_jod();
  }
  return parts_->target.kind == eval::Target::Kind::kPsnrLoss
             ? parts_->meter->psnr_loss(coded, observer)
             : parts_->meter->fidelity(coded, observer).psnr;
}

}  // namespace l4d::cli
