// SPDX-License-Identifier: Apache-2.0
#include "cli/input/rendering.h"

#include <memory>
#include <utility>

#include "cli/command/progress.h"
#include "cli/input/member_file.h"

namespace l4d::cli {

l4d_renderer_options renderer_options(const Context& context, const std::string& path,
                                      uint32_t renderers) {
  l4d_renderer_options options = L4D_INIT(l4d_renderer_options);
  options.threads = context.options.threads;
  options.max_memory_bytes = context.renderer_memory(renderers);
  options.cancel = interrupt_cell();
  // --backend reference is of decoders: images have --path for it.
  const bool cuda = context.backend() == L4D_BACKEND_CUDA;
  if (cuda && path == "reference") throw usage_error("--path reference contradicts --backend cuda");
  options.backend = cuda                  ? L4D_BACKEND_CUDA
                    : path == "reference" ? L4D_BACKEND_REFERENCE
                                          : L4D_BACKEND_CPU;
  return options;
}

eval::Rendering rendering_of(Context& context, const std::string& path, uint32_t scenes) {
  eval::Rendering rendering;
  rendering.holder = context.budget().holder();
  rendering.renderer_memory = rendering.holder(context.renderer_memory(scenes), "the renderer");
  rendering.decoder = context.decoder_options(2 * scenes);
  rendering.renderer = renderer_options(context, path, scenes);
  return rendering;
}

eval::RenderedScene render_input(Context& context, const Input& input,
                                 const ImportArguments& arguments, const std::string& path,
                                 uint32_t scenes, bool tolerant) {
  eval::Rendering rendering = rendering_of(context, path, scenes);
  rendering.decoder.tolerant = tolerant ? 1 : 0;
  eval::RenderedScene::Source source = eval::StreamFile{input.path()};
  if (input.is_scene()) {
    source = load_scene(context, input, arguments).scene;
  } else if (has_members(context, input)) {
    const auto reader = std::make_shared<FileReader>(input.path());
    source = about(input.name(), [&] {
      auto members = std::make_shared<eval::ShownMembers>(*reader->get(), rendering.decoder);
      note_unused(context, input, arguments, members->timeline());
      return eval::StreamMembers{reader, std::move(members)};
    });
  } else {
    about(input.name(), [&] {
      DecoderHandle decoder(&rendering.decoder);
      decoder.open_file(input.path());
      note_members(context, input, decoder.info().timeline);
      note_unused(context, input, arguments, decoder.info().timeline);
    });
  }
  return eval::RenderedScene(std::move(rendering), std::move(source), input.name());
}

}  // namespace l4d::cli
