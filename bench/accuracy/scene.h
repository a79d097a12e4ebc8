// SPDX-License-Identifier: Apache-2.0
// The scenes that accuracy is measured on, with the cameras that look at them.
#pragma once

#include <string>
#include <vector>

#include "eval/views/views.h"
#include "io/camera/cameras.h"
#include "io/synth/synth.h"

namespace l4d::bench {

struct BenchScene {
  std::string name;
  io::Scene scene;
  io::CameraSet set;
  std::vector<l4d_camera> cameras;  // of the set
  std::vector<uint32_t> training;   // those the scene was trained on, indices
  double fps = 0;

  double time_of(uint32_t frame) const {
    return scene.timeline.time_begin + static_cast<double>(frame) / fps;
  }
  // All training cameras at all instants.
  eval::CameraViews training_views() const;
  // [num_frames] or fewer, spread evenly from frame 0 on.
  std::vector<uint32_t> frames(uint32_t count) const;
};

// Folder with the basketball scene: $L4D_DATA_DIR, else ../shared/data. Throws io::Error,
// L4D_ERR_IO, where it is not there.
std::string basketball_dir();
BenchScene load_basketball();
// Looked at by orbiting cameras, all of which count as training cameras.
BenchScene make_synth(const io::SynthOptions& options, uint32_t num_cameras, uint32_t width,
                      uint32_t height);

}  // namespace l4d::bench
