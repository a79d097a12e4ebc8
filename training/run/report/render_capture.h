// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "io/camera/cameras.h"
#include "io/scene/scene.h"

namespace l4d::train {

struct RenderCaptureOptions {
  uint32_t cameras = 16;  // around the scene
  uint32_t width = 320, height = 240;
  // In place of these, cameras of a file, all of one size; "" = none.
  std::string camera_file;
  uint32_t points = 0;  // also write points.ply, of so many points
  uint32_t first_frame = 0;
  uint32_t frames = 0;  // 0 = all
  // "png" keeps values exactly but for 8 bits; "mp4" has the losses of videos, and needs ffmpeg.
  std::string format = "png";
  uint32_t threads = 0;
};

// Renders a scene as a capture with known truth: cameras.json, and images/CAMERA/FRAME.png or
// CAMERA.mp4. Every 8th camera is for tests, unless the file of cameras says which are. Returns
// the number of cameras. notes, which may be null: what the file of cameras says that images do not
// show. Throws io::Error.
uint32_t render_capture(const std::string& folder, const io::Scene& scene,
                        const RenderCaptureOptions& options,
                        std::vector<std::string>* notes = nullptr);

}  // namespace l4d::train
