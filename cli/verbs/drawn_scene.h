// SPDX-License-Identifier: Apache-2.0
// A scene whose pictures this process draws for a page. Only in builds that have the renderer.
#pragma once

#include "cli/command/context.h"
#include "cli/http/picture_request.h"
#include "cli/input/files.h"
#include "cli/input/scene_source.h"

namespace l4d::cli {

// Of any scene that the tool reads. The functions keep the scene.
Pictures draw_pictures(Context& context, const Input& input, const ImportArguments& arguments);

}  // namespace l4d::cli
