// SPDX-License-Identifier: Apache-2.0
// The tool's scenes as evaluations render them. Only in builds that have the renderer.
#pragma once

#include <string>

#include "cli/command/context.h"
#include "cli/input/files.h"
#include "cli/input/scene_source.h"
#include "eval/views/rendered_scene.h"

namespace l4d::cli {

l4d_renderer_options renderer_options(const Context& context, const std::string& path = "fast",
                                      uint32_t renderers = 1);

// path: "fast" or "reference". scenes: how many the command shows, which share its memory.
eval::Rendering rendering_of(Context& context, const std::string& path = "fast",
                             uint32_t scenes = 1);
// tolerant: as --tolerant has it.
eval::RenderedScene render_input(Context& context, const Input& input,
                                 const ImportArguments& arguments, const std::string& path = "fast",
                                 uint32_t scenes = 1, bool tolerant = false);

}  // namespace l4d::cli
