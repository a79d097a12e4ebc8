// SPDX-License-Identifier: Apache-2.0
// What verbs find in place of the renderer where it was not built. Each of these says so and ends
// the command; options that need it are refused before.
#include "cli/command/context.h"
#include "cli/input/rendering.h"
#include "cli/verbs/compare_renders.h"
#include "cli/verbs/drawn_scene.h"
#include "cli/verbs/importance.h"
#include "cli/verbs/verbs.h"
#include "cli/verbs/view_meter.h"

namespace l4d::cli {

Importance measure_importance(Context&, const std::string& verb, const io::Scene&,
                              const eval::CameraViews&, const MeasureArguments&) {
  require_renderer(verb);
  return {};
}

eval::Rendering rendering_of(Context&, const std::string&, uint32_t) {
  require_renderer("--refit");
  return {};
}

RendersCompared compare_renders(Context&, const Input&, const Input&, const ImportArguments&,
                                const CameraArguments&, const RenderOptions&,
                                const std::function<void(const Side&, const Side&)>&) {
  require_renderer("--cameras");
  return {};
}

struct ViewMeter::Parts {};

ViewMeter::ViewMeter(Context&, const eval::Target&, const std::string&, const io::Scene&,
                     const CameraArguments&) {
  require_renderer("this target");
}

ViewMeter::~ViewMeter() = default;

size_t ViewMeter::num_views() const { return 0; }

double ViewMeter::of(const eval::Encoding&, eval::Observer&) const { return 0; }

Pictures draw_pictures(Context&, const Input&, const ImportArguments&) {
  require_renderer("--pictures");
  return {};
}

void add_render(Registry& registry) {
  add_verb(registry, "render", "Not in this build, which has no renderer", [](Context&) -> Outcome {
    require_renderer("render");
    return {};
  })->take_anything();
}

}  // namespace l4d::cli
