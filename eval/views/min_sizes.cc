// SPDX-License-Identifier: Apache-2.0
#include "eval/views/min_sizes.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <tuple>

#include "eval/parallel.h"
#include "eval/scene/motion.h"

namespace l4d::eval {
namespace {

struct Eye {
  io::Vec3 at;
  double half_pixel;  // at a distance of 1

  bool operator<(const Eye& other) const {
    return std::tie(at, half_pixel) < std::tie(other.at, other.half_pixel);
  }
};

// Each place once.
std::vector<Eye> eyes_of(const io::CameraSet& cameras) {
  std::set<Eye> eyes;
  for (const io::Camera& one : cameras.cameras) {
    const double* m = one.camera.world_to_camera;
    Eye eye{};
    for (size_t k = 0; k < 3; ++k) eye.at[k] = -(m[k] * m[3] + m[4 + k] * m[7] + m[8 + k] * m[11]);
    eye.half_pixel = 0.5 / std::max(one.camera.fx, one.camera.fy);
    eyes.insert(eye);
  }
  return {eyes.begin(), eyes.end()};
}

// Between a point and the way from a to b.
double distance(const io::Vec3& point, const io::Vec3& a, const io::Vec3& b) {
  double along = 0, length2 = 0;
  for (size_t k = 0; k < 3; ++k) {
    along += (point[k] - a[k]) * (b[k] - a[k]);
    length2 += (b[k] - a[k]) * (b[k] - a[k]);
  }
  const double share = length2 > 0 ? std::clamp(along / length2, 0.0, 1.0) : 0;
  double sum = 0;
  for (size_t k = 0; k < 3; ++k) {
    const double d = point[k] - (a[k] + share * (b[k] - a[k]));
    sum += d * d;
  }
  return std::sqrt(sum);
}

}  // namespace

std::vector<float> min_sizes(const io::Scene& scene, const io::CameraSet& cameras,
                             uint32_t threads) {
  const std::vector<Eye> eyes = eyes_of(cameras);
  const double begin = scene.timeline.time_begin, end = begin + io::duration(scene.timeline);
  std::vector<float> sizes(scene.count());
  if (eyes.empty()) return sizes;
  for_each_block(scene.count(), threads, [&](size_t, size_t first, size_t last) {
    for (size_t i = first; i < last; ++i) {
      const Motion motion = motion_of(scene, i);
      const VisibleSpan span = visible_span(motion, begin, end);
      if (span.empty()) continue;
      const io::Vec3 from = motion.at(span.begin), to = motion.at(span.end);
      double least = HUGE_VAL;
      for (const Eye& eye : eyes) {
        least = std::min(least, eye.half_pixel * distance(eye.at, from, to));
      }
      // What is no number is for the encoder to tell of.
      sizes[i] = least < 1e30 ? static_cast<float>(least) : 0.0f;
    }
  });
  return sizes;
}

}  // namespace l4d::eval
