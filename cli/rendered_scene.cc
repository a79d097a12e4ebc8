// SPDX-License-Identifier: Apache-2.0
#include "cli/rendered_scene.h"

#include "cli/camera_arguments.h"
#include "cli/text/progress.h"

namespace l4d::cli {

namespace {

// Of an image, and of a file in the making: floats, bytes, and what compresses these.
constexpr uint64_t kPixelBytes = 3 * sizeof(float) + 3 * 3;

}  // namespace

l4d_renderer_options renderer_options(const Context& context, const std::string& path,
                                      uint32_t renderers) {
  l4d_renderer_options options;
  l4d_renderer_options_init(&options);
  options.threads = context.options.threads;
  options.max_memory_bytes = context.renderer_memory(renderers);
  options.path = path == "reference" ? L4D_RENDER_REFERENCE : L4D_RENDER_FAST;
  // The reference backend is of decoders: images have a path of their own for it.
  if (context.backend() == L4D_BACKEND_CUDA) options.backend = L4D_BACKEND_CUDA;
  return options;
}

RenderedScene::RenderedScene(Context& context, const std::string& name, const std::string& path,
                             uint32_t scenes)
    : context_(context),
      name_(name),
      renderer_memory_(context, context.renderer_memory(scenes), "the renderer"),
      decoder_([&] {
        const l4d_decoder_options options = context.decoder_options(2 * scenes);
        return DecoderHandle(&options);
      }()),
      renderer_([&] {
        const l4d_renderer_options options = renderer_options(context, path, scenes);
        return RendererHandle(&options);
      }()) {}

RenderedScene::RenderedScene(Context& context, const Input& input, const ImportArguments& arguments,
                             const std::string& path, uint32_t scenes)
    : RenderedScene(context, input.name(), path, scenes) {
  if (input.is_ply()) {
    loaded_ = load_scene(context, input, arguments).scene;
    show(*loaded_);
  } else {
    about(name_, [&] { decoder_.open_file(input.path()); });
    show_stream();
  }
}

RenderedScene::RenderedScene(Context& context, const io::Scene& scene, const std::string& name)
    : RenderedScene(context, name, "fast") {
  show(scene);
}

RenderedScene::RenderedScene(Context& context, const std::vector<unsigned char>& stream,
                             const std::string& name)
    : RenderedScene(context, name, "fast") {
  about(name_, [&] { decoder_.open_memory(stream.data(), stream.size()); });
  show_stream();
}

void RenderedScene::show(const io::Scene& scene) {
  scene_ = &scene;
  timeline_ = scene.timeline;
  count_ = scene.count();
  about(name_, [&] { renderer_.set_gaussians(scene.view(), timeline_); });
}

void RenderedScene::show_stream() {
  about(name_, [&] { renderer_.set_decoder(decoder_); });
  const l4d_info info = decoder_.info();
  timeline_ = info.timeline;
  count_ = info.num_gaussians;
}

io::Scene RenderedScene::instant(double seconds) const {
  return about(name_, [&] {
    const HeldMemory memory(context_, scene_ != nullptr ? 0 : slice_bytes(decoder_, seconds),
                            "an instant");
    return scene_ != nullptr ? instant_of(*scene_, seconds) : instant_of(decoder_, seconds);
  });
}

void RenderedScene::set_background(const float* rgb) {
  renderer_.check(l4d_renderer_set_background(renderer_.get(), rgb));
}

void RenderedScene::set_time(double seconds) {
  if (time_ == seconds) return;
  check_interrupt();
  about(name_, [&] { renderer_.set_time(seconds); });
  time_ = seconds;
}

void RenderedScene::render(const l4d_camera& camera, io::Image* image) {
  check_interrupt();
  if (image->width != camera.width || image->height != camera.height) {
    image_memory_.reset();
    image_memory_.emplace(context_, kPixelBytes * camera.width * camera.height, "an image");
    *image = io::Image(camera.width, camera.height);
  }
  about(name_, [&] { renderer_.render(camera, image->rgb.data()); });
}

}  // namespace l4d::cli
