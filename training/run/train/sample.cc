// SPDX-License-Identifier: Apache-2.0
#include "training/run/train/sample.h"

#include <iterator>
#include <mutex>

namespace l4d::train {
Sample::Sample(const Capture& capture, const ImageLoader& loader, const char* split, size_t most,
               const Colour& background, uint32_t threads)
    : capture_(capture), loader_(loader), background_(background), threads_(threads) {
  std::mutex mutex;
  loader.load(views_to_watch(capture, split, most), threads, [&](uint32_t view, Pixels pixels) {
    const std::lock_guard<std::mutex> lock(mutex);
    images_[view] = std::move(pixels);
  });
}

Score Sample::score(Trainer* trainer) const {
  Scorer scorer(nullptr, background_);
  for (const auto& [view, pixels] : images_) {
    scorer.add(pixels, loader_.mask(capture_.views[view].camera), trainer->render(view), threads_);
  }
  return scorer.score();
}

io::Image Sample::preview(Trainer* trainer) const {
  const auto& [view, pixels] = middle();
  return preview_of(image_of(pixels, background_), trainer->render(view));
}

io::Image Sample::beside(Trainer* trainer, const RenderView& stream) const {
  const auto& [view, pixels] = middle();
  return io::side_by_side({image_of(pixels, background_), trainer->render(view), stream(view)});
}

const std::pair<const uint32_t, Pixels>& Sample::middle() const {
  return *std::next(images_.begin(), static_cast<ptrdiff_t>(images_.size() / 2));
}

}  // namespace l4d::train
