// SPDX-License-Identifier: Apache-2.0
#include "eval/views/rendered_scene.h"

#include <algorithm>
#include <utility>

#include "eval/errors.h"
#include "eval/scene/decoded_scene.h"
#include "eval/views/views.h"

namespace l4d::eval {
namespace {

// Of an image, and of a file in the making: floats, bytes, and what compresses these.
constexpr uint64_t kPixelBytes = 3 * sizeof(float) + 3 * 3;

}  // namespace

RenderedScene::RenderedScene(Rendering rendering, Source source, std::string name)
    : rendering_(std::move(rendering)),
      name_(std::move(name)),
      source_(std::move(source)),
      decoder_(&rendering_.decoder),
      renderer_(&rendering_.renderer) {
  about(name_, [&] {
    if (const auto* borrowed = std::get_if<const io::Scene*>(&source_)) {
      show(**borrowed);
    } else if (const auto* kept = std::get_if<io::Scene>(&source_)) {
      show(*kept);
    } else if (const auto* file = std::get_if<StreamFile>(&source_)) {
      decoder_.open_file(file->path);
      show_stream();
    } else if (const auto* several = std::get_if<StreamMembers>(&source_)) {
      members_ = several->members.get();
      renderer_.set_rendering(nullptr);
      timeline_ = members_->timeline();
      count_ = members_->num_gaussians();
    } else {
      const auto& bytes = std::get<StreamBytes>(source_);
      decoder_.open_memory(bytes.data, bytes.size);
      show_stream();
    }
  });
}

void RenderedScene::show(const io::Scene& scene) {
  scene_ = &scene;
  timeline_ = scene.timeline;
  count_ = scene.count();
  renderer_.set_rendering(&scene.rendering);
  renderer_.set_gaussians(scene.view(), timeline_);
}

void RenderedScene::show_stream() {
  renderer_.set_rendering(nullptr);
  renderer_.set_decoder(decoder_, point_);
  const l4d_info info = decoder_.info();
  timeline_ = info.timeline;
  count_ = info.num_gaussians;
}

void RenderedScene::show_members(double seconds) {
  std::vector<l4d_decoder*> decoders;
  std::vector<double> shifts;
  for (const ShownMembers::Shown& s : members_->show(seconds)) {
    decoders.push_back(s.decoder->get());
    shifts.push_back(s.shift);
  }
  is_empty_ = decoders.empty();
  if (!is_empty_ && decoders != shown_) renderer_.set_streams(decoders, shifts, point_);
  shown_ = std::move(decoders);
  members_->close_others();
  if (!is_empty_) renderer_.set_time(members_->time());
}

l4d_presentation RenderedScene::presentation() const {
  if (scene_ != nullptr) return scene_->presentation;
  return members_ != nullptr ? members_->first().presentation() : decoder_.presentation();
}

io::Scene RenderedScene::instant(double seconds) const {
  return about(name_, [&] {
    // Position, opacity, mean time and scales; the last two are added to the slices of streams,
    // which have ten numbers or more.
    constexpr uint64_t kNumbers = 3 + 1 + 1 + 4;
    const auto held = [&](uint64_t bytes) {
      return io::hold(rendering_.holder, bytes, "an instant");
    };
    if (members_ != nullptr) {
      const std::shared_ptr<void> memory = held(members_->slice_bytes(seconds) / 2 * 3);
      return instant_of(*members_, seconds);
    }
    const std::shared_ptr<void> memory =
        held(scene_ != nullptr ? kNumbers * sizeof(float) * count_
                               : slice_bytes(decoder_, seconds, decoder_.info().sh_degree) / 2 * 3);
    return scene_ != nullptr ? instant_of(*scene_, seconds) : instant_of(decoder_, seconds);
  });
}

void RenderedScene::set_point(const l4d_operating_point& point) {
  point_ = point;
  if (scene_ == nullptr && members_ == nullptr) show_stream();
}

void RenderedScene::set_background(const float* rgb) {
  renderer_.check(l4d_renderer_set_background(renderer_.get(), rgb));
  std::copy_n(rgb, 3, background_);
}

void RenderedScene::set_time(double seconds) {
  if (time_ == seconds) return;
  about(name_, [&] { members_ != nullptr ? show_members(seconds) : renderer_.set_time(seconds); });
  time_ = seconds;
}

void RenderedScene::render(const l4d_camera& camera, io::Image* image) {
  if (image->width != camera.width || image->height != camera.height) {
    image_memory_.reset();
    image_memory_ =
        io::hold(rendering_.holder, kPixelBytes * camera.width * camera.height, "an image");
    *image = io::Image(camera.width, camera.height);
  }
  if (is_empty_) {
    for (size_t i = 0; i < image->rgb.size(); ++i) image->rgb[i] = background_[i % 3];
    return;
  }
  about(name_, [&] { renderer_.render(camera, image->rgb.data()); });
}

l4d_render_stats RenderedScene::stats() const {
  if (!is_empty_) return renderer_.stats();
  l4d_render_stats nothing = L4D_INIT(l4d_render_stats);
  return nothing;
}

}  // namespace l4d::eval
