// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

#include "training/capture/capture.h"

namespace l4d::train {

// Cameras of one clock, each with a video or numbered images: looks at what is there, and makes the
// views. set.frames and set.fps may be 0: the videos then say them. Throws as read_capture.
Capture make_video_capture(const std::string& path, io::CameraSet set,
                           const CaptureOptions& options);

// The numbered images of a folder, as a pattern (io::numbered_image) with the digits and the ending
// that its files have; %04d.png if it has none.
std::string numbered_images_in(const std::filesystem::path& folder);

// The points of a model of COLMAP, if the folder is one; none else.
void add_colmap_points(const std::string& model, const CaptureOptions& options, Capture* capture);

}  // namespace l4d::train
