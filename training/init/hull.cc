// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "training/init/start.h"
#include "training/model/random.h"

namespace l4d::train {
namespace {

constexpr size_t kInstants = 16;
constexpr uint64_t kTries = 4000000;  // points of an instant that are looked at, at most

// The pixel that shows a point, or -1.
int64_t pixel_of(const l4d_camera& camera, const double* p) {
  double v[3];
  for (size_t r = 0; r < 3; ++r) {
    const double* m = camera.world_to_camera + 4 * r;
    v[r] = m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3];
  }
  if (v[2] <= camera.near_plane) return -1;
  const double x = camera.fx * v[0] / v[2] + camera.cx, y = camera.fy * v[1] / v[2] + camera.cy;
  if (!(x >= 0 && y >= 0 && x < camera.width && y < camera.height)) return -1;
  return static_cast<int64_t>(y) * camera.width + static_cast<int64_t>(x);
}

// Fills `point` if all views that look at p show something there; false otherwise.
bool is_inside(const ImageLoader& loader, const ImageStore& store,
               const std::vector<uint32_t>& views, const double* p, Point* point) {
  std::vector<float> colours[3];
  for (const uint32_t view : views) {
    const int64_t pixel = pixel_of(loader.camera_of(view), p);
    if (pixel < 0) continue;
    const Pixels& image = store.image(view);
    const size_t at = static_cast<size_t>(pixel);
    if (image.alpha.empty() || image.alpha[at] < 128) return false;
    for (size_t c = 0; c < 3; ++c) {
      colours[c].push_back(static_cast<float>(image.rgb[3 * at + c]) / 255);
    }
  }
  if (2 * colours[0].size() < views.size() || colours[0].empty()) return false;
  for (size_t c = 0; c < 3; ++c) {
    const auto middle = colours[c].begin() + static_cast<ptrdiff_t>(colours[c].size() / 2);
    std::nth_element(colours[c].begin(), middle, colours[c].end());
    point->rgb[c] = *middle;
    point->position[c] = static_cast<float>(p[c]);
  }
  return true;
}

}  // namespace

std::vector<Point> hull_points(const Capture& capture, const ImageLoader& loader,
                               const std::vector<Instant>& instants, const ImageStore& store,
                               uint64_t count, uint64_t seed) {
  const CaptureFrame frame = frame_of(capture);
  const std::vector<uint32_t>& there = store.instants();
  std::vector<Point> points;
  if (there.empty() || store.image(instants[there[0]].views[0]).alpha.empty()) return points;
  const size_t chosen = std::min(kInstants, there.size());
  const uint64_t each = count / chosen + 1;
  for (size_t k = 0; k < chosen; ++k) {
    const Instant& instant = instants[there[k * there.size() / chosen]];
    // The object is often much smaller than the ring of cameras: the box of what is found first
    // bounds the search.
    double low[3], high[3];
    for (size_t c = 0; c < 3; ++c) {
      low[c] = frame.center[c] - frame.radius;
      high[c] = frame.center[c] + frame.radius;
    }
    uint64_t found = 0;
    bool is_tight = false;
    double box_low[3] = {HUGE_VAL, HUGE_VAL, HUGE_VAL},
           box_high[3] = {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL};
    for (uint64_t i = 0; i < kTries && found < each; ++i) {
      const Random4 r = philox(seed, 100 + k, i, Use::kStart);
      double p[3];
      for (size_t c = 0; c < 3; ++c) {
        p[c] = low[c] + (high[c] - low[c]) * static_cast<double>(uniform(r.v[c]));
      }
      Point point{};
      if (!is_inside(loader, store, instant.views, p, &point)) continue;
      point.time = static_cast<float>(instant.time);
      point.has_time = true;
      points.push_back(point);
      ++found;
      if (is_tight) continue;
      for (size_t c = 0; c < 3; ++c) {
        box_low[c] = std::min(box_low[c], p[c]);
        box_high[c] = std::max(box_high[c], p[c]);
      }
      if (found < 32) continue;
      is_tight = true;
      for (size_t c = 0; c < 3; ++c) {
        const double margin = 0.3 * (box_high[c] - box_low[c]);
        low[c] = std::max(low[c], box_low[c] - margin);
        high[c] = std::min(high[c], box_high[c] + margin);
      }
    }
  }
  return points;
}

}  // namespace l4d::train
