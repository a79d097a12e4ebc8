// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <fstream>
#include <string>

#include "training/tests/tiny_capture.h"

namespace l4d::train::test {

inline constexpr uint32_t kWidth = 24, kHeight = 18, kCameras = 4;  // of which 3 train

// A capture of a long scene, and points that live for a few frames each.
struct LongCapture {
  explicit LongCapture(double seconds) {
    io::SynthOptions options;
    options.seconds = seconds;
    options.fps = 10;
    options.gaussians = static_cast<uint32_t>(100 * seconds);
    options.seed = 7;
    io::Scene truth = io::synthesize(options);
    RenderCaptureOptions views;
    views.width = kWidth;
    views.height = kHeight;
    views.cameras = kCameras;
    render_capture(folder / "capture", truth, views);
    io::positions_to_mean_time(truth);
    std::ofstream out(folder / "points.ply");
    out << "ply\nformat ascii 1.0\nelement vertex " << truth.count()
        << "\nproperty float x\nproperty float y\nproperty float z\nproperty float t\nend_header\n";
    for (size_t i = 0; i < truth.count(); ++i) {
      for (size_t c = 0; c < 3; ++c) out << truth.position[3 * i + c] << " ";
      const double frame = std::round(10 * static_cast<double>(truth.mean_t[i]));
      out << std::clamp(frame, 0.0, 10 * seconds) / 10 << "\n";
    }
  }
  RunOptions run(const std::string& name, uint64_t steps, uint64_t resident) const {
    RunOptions options;
    options.folder = folder / name;
    options.threads = 1;
    Settings& s = options.settings;
    s.capture = folder / "capture";
    s.init = folder / "points.ply";
    s.gaussians = 4000;
    s.sh_degree = 1;
    s.views = 2;
    s.steps = steps;
    s.exposure = "off";
    s.adam = "sparse";
    s.resident = resident;
    // Four windows of 8 frames: three to draw from, and one that is read.
    s.host_memory = uint64_t{4} * 8 * (kCameras - 1) * kWidth * kHeight * 4;
    return options;
  }
  std::string scene(const std::string& name) const {
    return test::bytes_of(folder / (name + "/scene.ply"));
  }
  Folder folder;
};

}  // namespace l4d::train::test
