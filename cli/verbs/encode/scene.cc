// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs/encode/scene.h"

#include "eval/views/min_sizes.h"
#include "io/camera/first_view.h"
#include "io/scene/rendering_text.h"

namespace l4d::cli {
namespace {

// States where a player stands at first, unless the scene or an option says so: as in the piece
// before, if there is one.
void state_first_view(Context& context, const EncodeArguments& arguments,
                      const l4d_presentation* before, io::Scene* scene) {
  l4d_presentation& p = scene->presentation;
  if (arguments.no_first_view || p.has_camera != 0 || scene->count() == 0) return;
  scene->has_found_view = true;
  if (before != nullptr && before->has_camera != 0) {
    io::copy_first_view(*before, &p);
    return;
  }
  // Cameras that are made up say nothing of what there is to see.
  const io::CameraSet* cameras = arguments.cameras.load(context);
  const io::Hold holder = context.budget().holder();
  if (cameras != nullptr) io::state_first_view(*cameras, *scene, &p, holder);
  if (p.has_camera == 0) io::state_first_view(*scene, &p, holder);
}

}  // namespace

void change_statements(const EncodeArguments& arguments, l4d_rendering* rendering,
                       l4d_presentation* presentation) {
  const auto parse = [](const char* option, const std::string& text, const auto& change) {
    if (text.empty()) return;
    try {
      change();
    } catch (const io::Error& error) {
      throw usage_error(std::string(option) + ": " + error.what());
    }
  };
  parse("--rendering", arguments.rendering,
        [&] { io::parse_rendering(arguments.rendering, rendering); });
  parse("--presentation", arguments.presentation,
        [&] { io::parse_presentation(arguments.presentation, presentation); });
}

LoadedScene load(Context& context, const EncodeArguments& arguments, const Input& input,
                 bool may_be_empty, const l4d_presentation* before) {
  ImportArguments import = arguments.import;
  import.may_be_empty = may_be_empty;
  LoadedScene loaded = arguments.frames.empty()
                           ? load_scene(context, input, import)
                           : load_frames(context, arguments.frames, import, arguments.sequence);
  change_statements(arguments, &loaded.scene.rendering, &loaded.scene.presentation);
  state_first_view(context, arguments, before, &loaded.scene);
  return loaded;
}

void set_scene(Context& context, const EncodeArguments& arguments, const io::Scene& scene,
               const EncoderHandle& encoder, EncoderImportance* told) {
  const l4d_gaussians view = scene.view();
  encoder.check(l4d_encoder_set_scene(encoder.get(), &view, &scene.timeline, &scene.placement));
  encoder.check(l4d_encoder_set_rendering(encoder.get(), &scene.rendering));
  encoder.check(l4d_encoder_set_presentation(encoder.get(), &scene.presentation));
  // Cameras that are made up say nothing of where the scene will be seen from.
  if (const io::CameraSet* cameras = arguments.cameras.load(context)) {
    if (!told->has_min_sizes()) {
      told->set_min_sizes(eval::min_sizes(scene, *cameras, context.options.threads));
    }
    told->tell(encoder);
  }
}

}  // namespace l4d::cli
