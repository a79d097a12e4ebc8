// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "cli/common.h"
#include "cli/files.h"
#include "cli/scene_source.h"
#include "io/image.h"
#include "l4d/render.hpp"

namespace l4d::cli {

// A scene with a renderer that shows it. Of a stream only what is visible at an instant is decoded.
class RenderedScene {
 public:
  // path: "fast" or "reference". scenes: how many the command shows, which share its memory.
  RenderedScene(Context& context, const Input& input, const ImportArguments& arguments,
                const std::string& path = "fast", uint32_t scenes = 1);
  // Borrow the scene, or the stream in memory; `name` is for messages.
  RenderedScene(Context& context, const io::Scene& scene, const std::string& name);
  RenderedScene(Context& context, const std::vector<unsigned char>& stream,
                const std::string& name);
  RenderedScene(const RenderedScene&) = delete;
  RenderedScene& operator=(const RenderedScene&) = delete;

  const l4d_timeline& timeline() const { return timeline_; }
  uint64_t count() const { return count_; }
  io::Scene instant(double seconds) const;  // see cli/camera_arguments.h

  void set_background(const float* rgb);
  // L4D_DETAIL_*, of a stream; before the first instant.
  void set_detail(uint32_t detail) { decoder_.set_detail(detail); }
  // Moves to an instant; nothing happens where the scene is there already.
  void set_time(double seconds);
  // Resizes the image as needed.
  void render(const l4d_camera& camera, io::Image* image);
  l4d_render_stats stats() const { return renderer_.stats(); }

 private:
  RenderedScene(Context& context, const std::string& name, const std::string& path,
                uint32_t scenes = 1);
  void show(const io::Scene& scene);
  void show_stream();

  Context& context_;
  std::string name_;
  HeldMemory renderer_memory_;
  std::optional<HeldMemory> image_memory_;
  std::optional<io::Scene> loaded_;   // of a PLY
  const io::Scene* scene_ = nullptr;  // null for a stream; the renderer borrows it
  DecoderHandle decoder_;             // likewise
  RendererHandle renderer_;
  l4d_timeline timeline_{};
  uint64_t count_ = 0;
  std::optional<double> time_;
};

l4d_renderer_options renderer_options(const Context& context, const std::string& path = "fast",
                                      uint32_t renderers = 1);

}  // namespace l4d::cli
