// SPDX-License-Identifier: Apache-2.0
#include "training/run/train/places.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <map>

#include "training/sync/shift.h"

namespace l4d::train {
namespace {

constexpr size_t kCameras = 100, kLeastCameras = 5;
constexpr double kLeastAngle = 0.5, kOfOthers = 4;           // degrees; times the median
constexpr double kLeastCorrelation = 0.3, kLeastGain = 0.1;  // for a shift to be one
// How far it looks: parts of the width, and degrees where a long lens shows few.
constexpr double kLeastReach = 1.0 / 20, kReach = 3, kMostReach = 1.0 / 5;
constexpr double kDegree = 3.14159265358979323846 / 180;

// The first view of each training camera: of a video, no other frame is decoded for it.
std::map<uint32_t, uint32_t> first_views(const Capture& capture) {
  std::map<uint32_t, uint32_t> views;
  for (uint32_t k = 0; k < capture.views.size(); ++k) {
    const uint32_t camera = capture.views[k].camera;
    if (capture.cameras[camera].split == "train") views.emplace(camera, k);
  }
  return views;
}

}  // namespace

std::map<uint32_t, std::string> notes_of_places(const Capture& capture, const ImageLoader& loader,
                                                uint32_t threads, const Colour& background,
                                                const RenderView& render,
                                                const IsCancelled& cancelled) {
  std::vector<uint32_t> views;
  const std::map<uint32_t, uint32_t> all = first_views(capture);
  const size_t most = std::min(kCameras, all.size());
  size_t k = 0;
  for (const auto& [camera, view] : all) {
    if (views.size() < most && (2 * views.size() + 1) * all.size() / (2 * most) == k++) {
      views.push_back(view);
    }
  }
  std::map<uint32_t, std::string> notes;
  if (views.size() < kLeastCameras) return notes;
  std::map<uint32_t, double> angles;  // by camera; 0 where nothing says that it is moved
  std::vector<double> sorted;
  const auto look = [&](uint32_t view, const Pixels& pixels) {
    const uint32_t camera = capture.views[view].camera;
    const l4d_camera& lens = loader.camera(camera);
    const double reach = std::clamp(lens.fx * std::tan(kReach * kDegree), kLeastReach * lens.width,
                                    kMostReach * lens.width);
    const Shift shift =
        shift_between(image_of(pixels, background), render(view), loader.mask(camera), reach);
    const bool is_one =
        shift.correlation >= kLeastCorrelation && shift.correlation >= shift.unmoved + kLeastGain;
    angles[camera] =
        is_one ? std::atan(std::hypot(shift.x / lens.fx, shift.y / lens.fy)) / kDegree : 0;
    sorted.push_back(angles[camera]);
  };
  for_each_image(loader, views, threads, look, cancelled);
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  const double limit = std::max(kLeastAngle, kOfOthers * *middle);
  for (const auto& [camera, angle] : angles) {
    if (angle < limit) continue;
    char text[160];
    std::snprintf(text, sizeof(text),
                  " sees things %.1f degrees away from where the other cameras see them: its place "
                  "or lens may be wrong.",
                  angle);
    std::string note = capture.cameras[camera].name + text;
    note[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(note[0])));
    notes[camera] = note;
  }
  return notes;
}

}  // namespace l4d::train
