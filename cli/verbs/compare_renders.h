// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

#include "cli/command/context.h"
#include "cli/input/camera_arguments.h"
#include "cli/input/files.h"
#include "cli/input/scene_source.h"
#include "eval/image/lpips.h"
#include "eval/jod/jod.h"

namespace l4d::cli {

struct RenderOptions {
  bool images = false;  // also against what the cameras saw
  bool per_view = false;
  double gain = 1;  // of the map of differences
  const eval::Lpips* lpips = nullptr;
  const eval::JodDisplay* display = nullptr;  // of JOD; null = none
  Output* picture = nullptr;                  // of the worst view
};

// One of two scenes that are compared.
struct Side {
  l4d_timeline timeline;
  uint64_t count;
};

struct RendersCompared {
  Json json;
  std::string text;
  double fidelity_db = 0;
  double min_jod = 0;  // of the worst camera, where it was measured
};

// Renders both inputs. opened: called once both are open. Throws in builds without the renderer.
RendersCompared compare_renders(Context& context, const Input& a, const Input& b,
                                const ImportArguments& import, const CameraArguments& cameras,
                                const RenderOptions& options,
                                const std::function<void(const Side& a, const Side& b)>& opened);

}  // namespace l4d::cli
