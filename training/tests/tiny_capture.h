// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>

#include "io/synth/synth.h"
#include "training/run/report/render_capture.h"
#include "training/run/run.h"

namespace l4d::train::test {

// A folder that goes away.
class Folder {
 public:
  Folder() {
    std::string name = (std::filesystem::temp_directory_path() / "l4dtrain-XXXXXX").string();
    if (::mkdtemp(name.data()) != nullptr) path_ = name;
  }
  ~Folder() { std::filesystem::remove_all(path_); }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  std::string operator/(const std::string& name) const {
    return (std::filesystem::path(path_) / name).string();
  }

 private:
  std::string path_;
};

// 3,000 Gaussians for 2 s at 10 frames a second, seen by 16 cameras of 64 x 48 pixels, of which 14
// are for training.
inline io::Scene tiny_truth() {
  io::SynthOptions options;
  options.seconds = 2;
  options.fps = 10;
  options.gaussians = 3000;
  options.seed = 7;
  return io::synthesize(options);
}

// The capture of tiny_truth() in a folder that lives as long as the program.
inline const std::string& tiny_capture() {
  static Folder folder;
  static std::string path;
  if (path.empty()) {
    RenderCaptureOptions options;
    options.width = 64;
    options.height = 48;
    render_capture(folder / "capture", tiny_truth(), options);
    path = folder / "capture";
  }
  return path;
}

// Its first 8 frames, of 5 cameras, of which 4 are for training: where bits and files matter, and
// most of a short training would be to read and to score images.
inline const std::string& small_capture() {
  static Folder folder;
  static std::string path;
  if (path.empty()) {
    RenderCaptureOptions options;
    options.cameras = 5;
    options.frames = 8;
    options.width = 64;
    options.height = 48;
    render_capture(folder / "capture", tiny_truth(), options);
    path = folder / "capture";
  }
  return path;
}

// Where the Gaussians of the truth are at their mean times, off by 1 % of the scene.
inline void write_true_points(const std::string& path) {
  io::Scene truth = tiny_truth();
  io::positions_to_mean_time(truth);
  const size_t n = truth.count(), width = 3 * truth.sh_coefficients();
  double mean[3] = {0, 0, 0}, square = 0;
  for (size_t i = 0; i < n; ++i) {
    for (size_t c = 0; c < 3; ++c) {
      mean[c] += static_cast<double>(truth.position[3 * i + c]) / static_cast<double>(n);
    }
  }
  for (size_t i = 0; i < 3 * n; ++i) {
    square += std::pow(static_cast<double>(truth.position[i]) - mean[i % 3], 2);
  }
  std::mt19937 random(5);
  std::normal_distribution<double> noise(0, 0.01 * std::sqrt(square / static_cast<double>(n)));
  std::ofstream out(path);
  out << "ply\nformat ascii 1.0\nelement vertex " << n
      << "\nproperty float x\nproperty float y\nproperty float z\nproperty float red\n"
         "property float green\nproperty float blue\nproperty float t\nend_header\n";
  for (size_t i = 0; i < n; ++i) {
    for (size_t c = 0; c < 3; ++c) {
      out << static_cast<double>(truth.position[3 * i + c]) + noise(random) << " ";
    }
    for (size_t c = 0; c < 3; ++c) {
      // The lights of the scene are brighter than a point may be.
      out << std::clamp(0.5f + 0.28209479f * truth.sh[width * i + c], 0.0f, 1.0f) << " ";
    }
    out << truth.mean_t[i] << "\n";
  }
}

// Settings of small trainings.
inline RunOptions run_on(const std::string& capture, const std::string& folder, uint64_t steps) {
  RunOptions options;
  options.folder = folder;
  options.settings.capture = capture;
  options.settings.gaussians = 2000;
  options.settings.sh_degree = 1;
  options.settings.views = 2;
  options.settings.steps = steps;
  options.settings.init = "frustum";
  options.settings.exposure = "off";
  return options;
}

inline RunOptions tiny_run(const std::string& folder, uint64_t steps) {
  return run_on(tiny_capture(), folder, steps);
}
inline RunOptions small_run(const std::string& folder, uint64_t steps) {
  return run_on(small_capture(), folder, steps);
}

// Turned about the vertical axis of the camera.
inline void turn(l4d_camera* camera, double degrees) {
  const double a = degrees * 3.14159265358979323846 / 180, c = std::cos(a), s = std::sin(a);
  double* m = camera->world_to_camera;
  for (size_t k = 0; k < 4; ++k) {
    const double x = m[k], z = m[8 + k];
    m[k] = c * x + s * z;
    m[8 + k] = c * z - s * x;
  }
}

// Hears nothing; ends the run when `steps_left` training updates have come.
class Listener : public RunObserver {
 public:
  explicit Listener(uint64_t steps = UINT64_MAX) : steps_left_(steps) {}
  void update(uint64_t, uint64_t, const std::string& stage) override {
    if (stage.rfind("training", 0) == 0 && steps_left_ > 0) --steps_left_;
  }
  void note(const std::string& text) override { notes += text + "\n"; }
  bool cancelled() override { return steps_left_ == 0; }
  std::string notes;

 private:
  uint64_t steps_left_;
};

inline std::string bytes_of(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

// Four videos of twelve frames of 64 x 48 pixels, of which one tests. Needs ffmpeg.
inline void render_videos(const std::string& path) {
  RenderCaptureOptions options;
  options.cameras = 4;
  options.width = 64;
  options.height = 48;
  options.frames = 12;
  options.format = "mp4";
  render_capture(path, tiny_truth(), options);
}

}  // namespace l4d::train::test
