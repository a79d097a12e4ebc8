// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "io/camera/cameras.h"
#include "io/camera/read_cameras.h"
#include "io/scene/rotor_math.h"
#include "libl4dcodec/scene/slice.h"

namespace l4d::io {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kHalfView = kPi / 6;   // half of 60 degrees
constexpr double kElevation = kPi / 6;  // of the outer rings
constexpr uint32_t kCountForThreeRings = 12;
constexpr uint32_t kMaxOrbitCameras = 100000;
constexpr double kBallShare = 0.9;

using Weighted = std::pair<double, double>;  // value, weight

// The smallest value up to which `share` of the weight lies.
double weighted_quantile(std::vector<Weighted> values, double share) {
  std::sort(values.begin(), values.end());
  double total = 0;
  for (const Weighted& value : values) total += value.second;
  double sum = 0;
  for (const Weighted& value : values) {
    sum += value.second;
    if (sum >= share * total) return value.first;
  }
  return values.back().first;
}

// Positions where Gaussians are seen. Those of Gaussians whose mean time lies far outside the
// sequence can be far outside the scene.
std::vector<float> visible_positions(const Scene& scene) {
  Scene moved;
  moved.timeline = scene.timeline;
  moved.flags = scene.flags;
  moved.position = scene.position;
  if ((scene.flags & L4D_POSITION_AT_MEAN_TIME) != 0) {
    moved.mean_t = scene.mean_t;
    moved.mean_t_double = scene.mean_t_double;
    moved.window = scene.window;
    moved.log_scale = scene.log_scale;
    moved.rotor = scene.rotor;
    positions_to_reference_time(moved);
  }
  return std::move(moved.position);
}

struct Extent {
  Vec3 center{};
  double radius = 0;
  size_t up_axis = 1;
};

Extent extent_of(const Scene& scene) {
  const std::vector<float> position = visible_positions(scene);
  std::array<std::vector<Weighted>, 3> axes;
  const bool is_logit = (scene.flags & L4D_OPACITY_LOGIT) != 0;
  for (size_t i = 0; i < scene.count(); ++i) {
    const double stored = static_cast<double>(scene.opacity[i]);
    const double opacity = linear_opacity(stored, is_logit);
    bool usable = opacity > 0 && std::isfinite(opacity);
    for (size_t k = 0; k < 3; ++k) usable = usable && std::isfinite(position[3 * i + k]);
    if (!usable) continue;
    for (size_t k = 0; k < 3; ++k) {
      axes[k].emplace_back(static_cast<double>(position[3 * i + k]), opacity);
    }
  }
  if (axes[0].empty()) {
    throw Error(L4D_ERR_INVALID_SCENE, "no Gaussian is visible: there is nothing to look at");
  }

  Extent extent;
  Vec3 spread{};
  std::vector<Weighted> distance(axes[0].size());
  for (size_t k = 0; k < 3; ++k) {
    extent.center[k] = weighted_quantile(axes[k], 0.5);
    for (size_t i = 0; i < distance.size(); ++i) {
      const double d = axes[k][i].first - extent.center[k];
      distance[i].first += d * d;
      axes[k][i].first = std::abs(d);
    }
    for (size_t i = 0; i < distance.size(); ++i) distance[i].second = axes[k][i].second;
    spread[k] = weighted_quantile(std::move(axes[k]), kBallShare);
  }
  extent.radius = std::sqrt(weighted_quantile(std::move(distance), kBallShare));
  if (!(extent.radius > 0)) extent.radius = 1;  // all in one point
  extent.up_axis = 2 * spread[2] < spread[1] ? 2 : 1;
  return extent;
}

double up_sign(const Scene& scene, size_t up_axis) {
  if (up_axis == 2) return 1;
  return scene.placement.coordinate_system == L4D_COORDINATES_RIGHT_UP_BACK ? 1 : -1;
}

Vec3 cross(const Vec3& a, const Vec3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

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

void look_at_center(const Extent& extent, const Vec3& up, const Vec3& towards, double distance,
                    l4d_camera& camera) {
  Vec3 forward, center;
  for (size_t k = 0; k < 3; ++k) {
    forward[k] = -towards[k];
    center[k] = extent.center[k] + distance * towards[k];
  }
  Vec3 right = cross(forward, up);
  const double length = std::sqrt(right[0] * right[0] + right[1] * right[1] + right[2] * right[2]);
  for (double& r : right) r /= length;
  const Vec3 down = cross(forward, right);
  double axes[9];
  for (size_t k = 0; k < 3; ++k) {
    axes[3 * k] = right[k];
    axes[3 * k + 1] = down[k];
    axes[3 * k + 2] = forward[k];
  }
  set_pose(camera, axes, center.data());
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
  const Extent extent = extent_of(scene);
  Vec3 up{};
  up[extent.up_axis] = up_sign(scene, extent.up_axis);
  const double distance = extent.radius / std::sin(kHalfView);

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
      look_at_center(extent, up, direction(up, 2 * kPi * turn, elevations[ring]), distance,
                     camera.camera);
      set.cameras.push_back(std::move(camera));
    }
  }
  set.notes.push_back("The cameras are made up: an orbit around the scene.");
  return set;
}

}  // namespace l4d::io
