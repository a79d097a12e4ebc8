// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs/frame_sink.h"

#include "cli/command/progress.h"

namespace l4d::cli {

FrameSink::FrameSink(Context& context, const std::vector<std::string>& names) {
  for (const std::string& name : names) outputs_.push_back(std::make_unique<Output>(context, name));
}

void FrameSink::open_video(uint32_t width, uint32_t height, const io::VideoOptions& options) {
  video_.emplace(outputs_[0]->path(), width, height, options);
}

void FrameSink::write(size_t frame, const io::Image& image) {
  if (video_) {
    video_->write(image);
  } else {
    io::write_png(outputs_[frame]->path(), image, check_interrupt);
    bytes_ += outputs_[frame]->finish();
  }
}

uint64_t FrameSink::finish() {
  if (video_) {
    video_->finish();
    bytes_ += outputs_[0]->finish();
  }
  return bytes_;
}

}  // namespace l4d::cli
