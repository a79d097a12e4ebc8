// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <utility>

#include "io/camera/cameras.h"
#include "io/camera/first_view.h"
#include "io/camera/read_cameras.h"
#include "io/camera/subject.h"
#include "io/scene/rotor_math.h"

namespace l4d::io {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kHalfView = kPi / 6;   // half of 60 degrees
constexpr double kElevation = kPi / 6;  // of the outer rings
constexpr uint32_t kCountForThreeRings = 12;
constexpr uint32_t kMaxOrbitCameras = 100000;

// Towards a camera of an orbit around `up`.
Vec3 direction(const Vec3& up, double azimuth, double elevation) {
  const Vec3 across = {1, 0, 0};  // no axis of an orbit
  const Vec3 along = cross(up, across);
  Vec3 out;
  for (size_t k = 0; k < 3; ++k) {
    out[k] = std::cos(elevation) * (std::cos(azimuth) * across[k] + std::sin(azimuth) * along[k]) +
             std::sin(elevation) * up[k];
  }
  return out;
}

void look_at_center(const Subject& subject, const Vec3& up, const Vec3& towards, double distance,
                    l4d_camera& camera) {
  Vec3 forward, center;
  for (size_t k = 0; k < 3; ++k) {
    forward[k] = -towards[k];
    center[k] = subject.center[k] + distance * towards[k];
  }
  place(center, forward, up, camera);
}

}  // namespace

CameraSet orbit_cameras(const Scene& scene, uint32_t count, uint32_t width, uint32_t height) {
  if (count < 1 || count > kMaxOrbitCameras) {
    throw Error(L4D_ERR_INVALID_ARGUMENT,
                "an orbit has 1 to " + std::to_string(kMaxOrbitCameras) + " cameras");
  }
  for (const uint32_t size : {width, height}) {
    if (size >= 1 && size <= kMaxImageSize) continue;
    throw Error(L4D_ERR_INVALID_ARGUMENT,
                "images have 1 to " + std::to_string(kMaxImageSize) + " pixels a side");
  }
  const Subject subject = subject_of(scene);
  const Vec3& up = subject.up;
  const double distance = subject.radius / std::sin(kHalfView);

  CameraSet set;
  set.source = "orbit";
  const std::vector<double> elevations = count < kCountForThreeRings
                                             ? std::vector<double>{0}
                                             : std::vector<double>{0, -kElevation, kElevation};
  const uint32_t rings = static_cast<uint32_t>(elevations.size());
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
      camera.camera.near_plane = std::min(camera.camera.near_plane, 0.01 * distance);
      look_at_center(subject, up, direction(up, 2 * kPi * turn, elevations[ring]), distance,
                     camera.camera);
      set.cameras.push_back(std::move(camera));
    }
  }
  set.notes.push_back("The cameras are made up: an orbit around the scene.");
  return set;
}

}  // namespace l4d::io
