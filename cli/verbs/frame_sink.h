// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cli/command/context.h"
#include "cli/input/files.h"
#include "io/image/image.h"
#include "io/image/video.h"

namespace l4d::cli {

// Takes the frames of a rendering in order, whatever they become.
class FrameSink {
 public:
  // One PNG for each name; none of them is written before all have been checked.
  FrameSink(Context& context, const std::vector<std::string>& names);
  // The one name there is becomes a video instead.
  void open_video(uint32_t width, uint32_t height, const io::VideoOptions& options);
  void write(size_t frame, const io::Image& image);
  uint64_t finish();  // bytes of all files
  bool is_stdout() const { return outputs_[0]->is_stdout(); }

 private:
  std::vector<std::unique_ptr<Output>> outputs_;
  std::optional<io::VideoWriter> video_;
  uint64_t bytes_ = 0;
};

}  // namespace l4d::cli
