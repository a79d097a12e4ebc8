// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "io/camera/cameras.h"
#include "io/camera/first_view.h"
#include "io/camera/read_cameras.h"
#include "io/camera/sight_grid.h"
#include "io/camera/subject.h"
#include "io/camera/vectors.h"

namespace l4d::io {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kHalfView = kPi / 6;  // half of 60 degrees
constexpr uint32_t kCountForThreeRings = 12;
constexpr uint32_t kMaxOrbitCameras = 100000;

// A ring of an orbit around `up` through `center`; others lie below and above it.
struct Ring {
  Vec3 center, up;
  Vec3 level;             // towards the first camera
  double height;          // over the center
  double tilt;            // of the others, radians
  std::vector<double> r;  // distances from the axis, at turns of 1 / r.size()

  Vec3 eye(double turn, double tilted = 0) const {
    const double n = static_cast<double>(r.size()), at = n * (turn - std::floor(turn));
    const size_t k = static_cast<size_t>(at) % r.size();
    const double part = at - std::floor(at);
    const double distance = (1 - part) * r[k] + part * r[(k + 1) % r.size()];
    const double azimuth = 2 * kPi * turn, elevation = std::atan2(height, distance) + tilted;
    const double reach = std::hypot(height, distance);
    const Vec3 flat =
        ahead(ahead({0, 0, 0}, std::cos(azimuth), level), std::sin(azimuth), cross(up, level));
    return ahead(ahead(center, reach * std::cos(elevation), flat), reach * std::sin(elevation), up);
  }
};

Ring ring_around(const Subject& subject) {
  return {
      subject.center, subject.up, {1, 0, 0}, 0, kPi / 6, {subject.radius / std::sin(kHalfView)}};
}

// Places are seen from inside. If the scene states a view from within its subject, the ring begins
// there, around the middle, and keeps within the walls.
std::optional<Ring> ring_within(const Scene& scene, const Subject& subject) {
  constexpr size_t kLookouts = 32, kBeside = 2;
  constexpr double kEnough = 0.5, kLeast = 0.25, kStep = 0.05;
  const l4d_presentation& view = scene.presentation;
  if (view.has_camera == 0) return std::nullopt;
  Vec3 eye, target, up;
  std::copy_n(view.camera_position, 3, eye.begin());
  std::copy_n(view.camera_target, 3, target.begin());
  std::copy_n(view.camera_up, 3, up.begin());
  up = unit(up);
  const Vec3 center = ahead(subject.center, dot(minus(target, subject.center), up), up);
  const Vec3 arm = minus(eye, center);
  const double height = dot(arm, up), distance = length(ahead(arm, -height, up));
  if (length(minus(eye, subject.center)) >= subject.radius || distance < std::abs(height)) {
    return std::nullopt;
  }
  Ring ring{center, up, unit(ahead(arm, -height, up)), height, kPi / 18, {}};
  // As far from the middle as the view, or where half of what can be seen is seen.
  const SightGrid grid(scene, subject);
  std::vector<double> free(kLookouts);
  for (size_t k = 0; k < kLookouts; ++k) {
    std::vector<double> seen;
    const auto at = [&](size_t step) { return distance * (1 - kStep * static_cast<double>(step)); };
    while (at(seen.size()) >= kLeast * distance) {
      ring.r = {at(seen.size())};
      const double turn = static_cast<double>(k) / static_cast<double>(kLookouts);
      seen.push_back(grid.seen_from(ring.eye(turn), center, up));
    }
    const double enough = kEnough * *std::max_element(seen.begin(), seen.end());
    size_t step = 0;
    while (seen[step] < enough) ++step;
    free[k] = at(step);
  }
  // Smooth, and nowhere beyond what is free.
  std::vector<double> least(kLookouts);
  ring.r.assign(kLookouts, 0);
  for (size_t k = 0; k < kLookouts; ++k) {
    least[k] = free[k];
    for (size_t n = 0; n <= 2 * kBeside; ++n) {
      least[k] = std::min(least[k], free[(k + n + kLookouts - kBeside) % kLookouts]);
    }
  }
  for (size_t k = 0; k < kLookouts; ++k) {
    for (size_t n = 0; n <= 2 * kBeside; ++n) {
      ring.r[k] += least[(k + n + kLookouts - kBeside) % kLookouts] / (2 * kBeside + 1);
    }
  }
  return ring;
}

}  // namespace

CameraSet orbit_cameras(const Scene& scene, uint32_t count, uint32_t width, uint32_t height,
                        const Hold& holder) {
  if (count < 1 || count > kMaxOrbitCameras) {
    throw Error(L4D_ERR_INVALID_ARGUMENT,
                "an orbit has 1 to " + std::to_string(kMaxOrbitCameras) + " cameras");
  }
  for (const uint32_t size : {width, height}) {
    if (size >= 1 && size <= kMaxImageSize) continue;
    throw Error(L4D_ERR_INVALID_ARGUMENT,
                "images have 1 to " + std::to_string(kMaxImageSize) + " pixels a side");
  }
  const std::shared_ptr<void> memory = hold(holder, subject_bytes(scene), "an orbit");
  const Subject subject = whole_subject_of(scene);
  const std::optional<Ring> within = ring_within(scene, subject);
  const Ring orbit = within ? *within : ring_around(subject);

  CameraSet set;
  set.source = "orbit";
  const std::vector<double> tilts = count < kCountForThreeRings
                                        ? std::vector<double>{0}
                                        : std::vector<double>{0, -orbit.tilt, orbit.tilt};
  const uint32_t rings = static_cast<uint32_t>(tilts.size());
  for (uint32_t ring = 0; ring < rings; ++ring) {
    const uint32_t cameras = count / rings + (ring < count % rings ? 1 : 0);
    for (uint32_t i = 0; i < cameras; ++i) {
      // Rings are turned against each other, so that together they see from more sides.
      const double turn = (i + static_cast<double>(ring) / rings) / cameras;
      Camera camera;
      camera.id = static_cast<int>(set.cameras.size());
      camera.camera = default_camera();
      camera.camera.width = width;
      camera.camera.height = height;
      camera.camera.fx = camera.camera.fy =
          0.5 * static_cast<double>(std::min(width, height)) / std::tan(kHalfView);
      camera.camera.cx = 0.5 * static_cast<double>(width);
      camera.camera.cy = 0.5 * static_cast<double>(height);
      // A scene may be smaller than the plane's usual distance.
      camera.camera.near_plane = std::min(camera.camera.near_plane, 0.01 * orbit.r[0]);
      const Vec3 eye = orbit.eye(turn, tilts[ring]);
      place(eye, unit(minus(orbit.center, eye)), orbit.up, camera.camera);
      set.cameras.push_back(std::move(camera));
    }
  }
  set.notes.push_back("The cameras are made up: an orbit " +
                      std::string(within ? "within" : "around") + " the scene.");
  return set;
}

}  // namespace l4d::io
