// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "eval/scene/shown_members.h"
#include "io/file/memory.h"
#include "io/image/image.h"
#include "io/scene/scene.h"
#include "l4d/render.hpp"

namespace l4d::eval {

// How a scene is rendered.
struct Rendering {
  l4d_decoder_options decoder;
  l4d_renderer_options renderer;
  io::Hold holder;                        // counts images, and what an instant takes
  std::shared_ptr<void> renderer_memory;  // what the renderer itself is counted as

  Rendering() {
    decoder = L4D_INIT(l4d_decoder_options);
    renderer = L4D_INIT(l4d_renderer_options);
  }
};

struct StreamFile {
  std::string path;
};
struct StreamBytes {  // borrowed
  const unsigned char* data;
  size_t size;
};

// A file of several streams; `reader` is what the members are read by.
struct StreamMembers {
  std::shared_ptr<void> reader;
  std::shared_ptr<ShownMembers> members;
};

// A scene with a renderer that shows it. Of a stream only what is visible at an instant is decoded.
class RenderedScene {
 public:
  // A scene that is borrowed, one that is kept, or a stream.
  using Source = std::variant<const io::Scene*, io::Scene, StreamFile, StreamBytes, StreamMembers>;
  // name: messages of the io::Error that is thrown begin with it.
  RenderedScene(Rendering rendering, Source source, std::string name);
  RenderedScene(const RenderedScene&) = delete;
  RenderedScene& operator=(const RenderedScene&) = delete;

  const std::string& name() const { return name_; }
  const l4d_timeline& timeline() const { return timeline_; }
  uint64_t count() const { return count_; }
  l4d_presentation presentation() const;    // of several streams that of the first
  io::Scene instant(double seconds) const;  // as instant_of (eval/views/views.h)

  void set_background(const float* rgb);
  // How much of a stream is shown; before the first instant.
  void set_point(const l4d_operating_point& point);
  // Moves to an instant; nothing happens where the scene is there already.
  void set_time(double seconds);
  // Resizes the image as needed.
  void render(const l4d_camera& camera, io::Image* image);
  l4d_render_stats stats() const;

  // Calls f(decoder, place of its stream in the file) for each stream that the instant shows, of
  // which decoders that are tolerant know what was lost to it.
  template <typename F>
  void for_each_stream(const F& f) const {
    if (scene_ != nullptr) return;
    if (members_ == nullptr) return f(decoder_, uint64_t{0});
    for (const ShownMembers::Shown& s : members_->shown()) f(*s.decoder, s.offset);
  }
  // As ShownMembers::left_out; empty for other scenes.
  std::map<uint32_t, std::string> left_out() const {
    return members_ == nullptr ? std::map<uint32_t, std::string>() : members_->left_out();
  }

 private:
  void show(const io::Scene& scene);
  void show_stream();
  void show_members(double seconds);

  Rendering rendering_;
  std::string name_;
  Source source_;  // the renderer borrows it
  std::shared_ptr<void> image_memory_;
  const io::Scene* scene_ = nullptr;  // null for a stream
  ShownMembers* members_ = nullptr;   // null for other scenes
  std::vector<l4d_decoder*> shown_;   // of members_, that the renderer has
  DecoderHandle decoder_;             // likewise borrowed
  RendererHandle renderer_;
  l4d_timeline timeline_{};
  uint64_t count_ = 0;
  std::optional<double> time_;
  l4d_operating_point point_{};
  float background_[3] = {};
  bool is_empty_ = false;  // every member that the instant shows is left out
};

}  // namespace l4d::eval
