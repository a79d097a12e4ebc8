// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <map>

#include "io/image/video.h"
#include "training/capture/capture.h"
#include "training/capture/tolerance.h"

// transforms.json of nerfstudio and instant-ngp, or D-NeRF's transforms_train.json and
// transforms_test.json: an image and a camera for each frame.
namespace l4d::train {
namespace {

namespace fs = std::filesystem;
using io::Error;

bool same_camera(const io::Camera& one, const io::Camera& other) {
  const l4d_camera &a = one.camera, &b = other.camera;
  bool same = one.mask == other.mask && io::same_lens(one.distortion, other.distortion) &&
              a.width == b.width && a.height == b.height && a.fx == b.fx && a.fy == b.fy &&
              a.cx == b.cx && a.cy == b.cy;
  for (size_t k = 0; k < 12; ++k) {
    same = same && std::abs(a.world_to_camera[k] - b.world_to_camera[k]) <= 1e-6;
  }
  return same;
}

// The smallest step between distinct times, as a frame rate.
double fps_of(std::vector<double> times) {
  std::sort(times.begin(), times.end());
  double step = 0;
  for (size_t k = 1; k < times.size(); ++k) {
    const double d = times[k] - times[k - 1];
    if (d > 1e-6 && (step == 0 || d < step)) step = d;
  }
  if (step == 0) return 1;
  const double fps = 1 / step;
  return std::abs(fps - std::round(fps)) < 0.01 ? std::round(fps) : fps;
}

class DnerfReader {
 public:
  DnerfReader(const std::string& folder, const CaptureOptions& options)
      : folder_(folder), options_(options) {}

  Capture read() {
    capture_.layout = "dnerf";
    // Test images first: what is in both files is for tests.
    const auto is_there = [&](const char* file) { return fs::exists(fs::path(folder_) / file); };
    if (!is_there("transforms_train.json")) {
      capture_.layout = "transforms";
      add("transforms.json");
    } else {
      if (is_there("transforms_test.json")) add("transforms_test.json");
      add("transforms_train.json");
    }
    std::vector<double> times;
    for (const CaptureView& view : capture_.views) times.push_back(view.time);
    capture_.fps = options_.fps > 0 ? options_.fps : fps_of(times);
    for (CaptureView& view : capture_.views) {
      const double frame = std::round(view.time * capture_.fps);
      if (!(frame < L4D_MAX_FRAMES)) {
        throw Error(L4D_ERR_CORRUPT, folder_ + ": the image " + view.file + " is at " +
                                         std::to_string(view.time) + " s, which is frame " +
                                         std::to_string(frame) + "; there are at most " +
                                         std::to_string(L4D_MAX_FRAMES));
      }
      view.frame = static_cast<uint32_t>(frame);
      capture_.frames = std::max(capture_.frames, view.frame + 1);
    }
    // The test camera of a capture with few cameras has images in both files.
    if (repeated_ > 0) {
      capture_.notes.push_back(std::to_string(repeated_) +
                               " images are in the files for training and for tests; they are "
                               "used for tests alone.");
    }
    left_out_.append_to(&capture_.notes);
    return std::move(capture_);
  }

 private:
  uint32_t camera_index(const io::Camera& source) {
    for (uint32_t k = 0; k < capture_.cameras.size(); ++k) {
      if (same_camera(capture_.cameras[k].source, source)) return k;
    }
    CaptureCamera camera;
    camera.source = source;
    camera.source.id = static_cast<int>(capture_.cameras.size());
    camera.name = "camera " + std::to_string(camera.source.id);
    camera.split = source.split;
    capture_.cameras.push_back(std::move(camera));
    return static_cast<uint32_t>(capture_.cameras.size() - 1);
  }

  void add(const char* name) {
    const std::string file = (fs::path(folder_) / name).string();
    const io::CameraSet set = io::read_cameras(file, options_.any_path, options_.holder);
    for (const std::string& note : set.notes) {
      const auto& notes = capture_.notes;
      if (std::find(notes.begin(), notes.end(), note) == notes.end()) {
        capture_.notes.push_back(note);
      }
    }
    if (!set.points.empty()) capture_.points_file = set.points;
    for (const io::Camera& source : set.cameras) {
      io::require_inside(set, source);
      if (options_.tolerant) {
        const std::string trouble = trouble_of_image(source.image, source.camera);
        if (!trouble.empty()) {
          left_out_.add(file + ": camera " + std::to_string(source.id) + ": " + trouble);
          continue;
        }
      }
      const uint32_t index = camera_index(source);
      if (capture_.cameras[index].split != source.split) {
        ++repeated_;
        continue;
      }
      std::error_code error;
      if (!fs::is_regular_file(source.image, error)) {
        throw Error(L4D_ERR_IO, file + ": camera " + std::to_string(source.id) +
                                    ": cannot open the image " + source.image);
      }
      CaptureView view{index, 0, source.time.value_or(0) * options_.seconds, source.image};
      capture_.views.push_back(std::move(view));
    }
  }

  std::string folder_;
  const CaptureOptions& options_;
  Capture capture_;
  size_t repeated_ = 0;
  LeftOut left_out_;
};

}  // namespace

Capture read_dnerf_capture(const std::string& folder, const CaptureOptions& options) {
  return DnerfReader(folder, options).read();
}

}  // namespace l4d::train
