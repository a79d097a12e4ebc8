// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "training/capture/capture.h"

namespace l4d::train {

// Cameras of one clock, each with a video or numbered images: looks at what is there, and makes the
// views. set.frames and set.fps may be 0: the videos then say them. Throws as read_capture.
Capture make_video_capture(const std::string& path, const io::CameraSet& set,
                           const CaptureOptions& options);

// The image of frame `frame`, where `pattern` has one %d or %04d for it.
std::string numbered_image(const std::string& pattern, uint32_t frame);

}  // namespace l4d::train
