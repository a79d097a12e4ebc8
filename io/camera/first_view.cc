// SPDX-License-Identifier: Apache-2.0
#include "io/camera/first_view.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <utility>

#include "io/camera/read_cameras.h"
#include "io/camera/sight_grid.h"
#include "io/camera/subject.h"
#include "io/camera/vectors.h"

namespace l4d::io {
namespace {

constexpr double kSteepest = 1.5;  // radians above the horizon

// ---- from cameras ----

Vec3 row_of(const l4d_camera& camera, size_t row) {  // right, down, forward
  const double* m = camera.world_to_camera + 4 * row;
  return {m[0], m[1], m[2]};
}

Vec3 center_of(const l4d_camera& camera) {
  const double* m = camera.world_to_camera;
  Vec3 center;
  for (size_t c = 0; c < 3; ++c) {
    center[c] = -(m[c] * m[3] + m[4 + c] * m[7] + m[8 + c] * m[11]);
  }
  return center;
}

// The point with the least squared distance to the axes of all cameras, and a little to `near`,
// which decides where the axes do not: sum of (I - d d^T) (x - c) = 0.
Vec3 point_of_axes(const std::vector<l4d_camera>& cameras, const Vec3& near) {
  constexpr double kLittle = 1e-4;
  const double little = kLittle * static_cast<double>(cameras.size());
  Vec3 rows[3] = {{little, 0, 0}, {0, little, 0}, {0, 0, little}}, b{};
  for (const l4d_camera& camera : cameras) {
    const Vec3 d = row_of(camera, 2), c = minus(center_of(camera), near);
    for (size_t r = 0; r < 3; ++r) {
      for (size_t k = 0; k < 3; ++k) rows[r][k] += (r == k ? 1 : 0) - d[r] * d[k];
      b[r] += c[r] - d[r] * dot(d, c);
    }
  }
  // Symmetric: columns are rows. Cramer's rule.
  const double all = dot(rows[0], cross(rows[1], rows[2]));
  return ahead(near, 1 / all,
               {dot(b, cross(rows[1], rows[2])), dot(rows[0], cross(b, rows[2])),
                dot(rows[0], cross(rows[1], b))});
}

void set_camera(const Vec3& eye, const Vec3& target, const Vec3& up, double fov,
                l4d_presentation* p) {
  constexpr double kWidest = 2.9;  // the format ends at 3
  std::copy_n(eye.begin(), 3, p->camera_position);
  std::copy_n(target.begin(), 3, p->camera_target);
  std::copy_n(up.begin(), 3, p->camera_up);
  p->camera_fov = std::min(fov, kWidest);
  p->has_camera = 1;
}

// ---- from the scene ----

constexpr double kFov = 0.8727;  // 50 degrees, of the height

// Nothing if no Gaussian is visible.
std::optional<Subject> visible_subject(const Scene& scene) {
  try {
    return subject_of(scene);
  } catch (const Error&) {
    return std::nullopt;
  }
}

// The camera with the highest score among those that look ahead rather than up or down: kLevel
// more of that than the one with the least are left out.
const l4d_camera& best_of(const std::vector<l4d_camera>& cameras, const Vec3& up,
                          const std::function<double(const l4d_camera&)>& score) {
  constexpr double kLevel = 0.2;  // of the sine of the elevation
  const auto steepness = [&](const l4d_camera& c) { return std::abs(dot(row_of(c, 2), up)); };
  double least = 1;
  for (const l4d_camera& camera : cameras) least = std::min(least, steepness(camera));
  const l4d_camera* best = nullptr;
  double most = 0;
  for (const l4d_camera& camera : cameras) {
    if (steepness(camera) > least + kLevel) continue;
    const double value = score(camera);
    if (best != nullptr && !(value > most)) continue;
    best = &camera;
    most = value;
  }
  return *best;
}

// Up of most cameras; of the camera itself where that is no direction.
Vec3 common_up(const std::vector<l4d_camera>& cameras) {
  Vec3 sum{};
  for (const l4d_camera& camera : cameras) sum = minus(sum, row_of(camera, 1));
  const double share = length(sum) / static_cast<double>(cameras.size());
  return share > 0.1 ? unit(sum) : ahead({0, 0, 0}, -1, row_of(cameras[0], 1));
}

// The camera's own up, but for one that was held askew.
Vec3 upright(const l4d_camera& camera, const Vec3& up) {
  constexpr double kHeldStraight = 0.94;  // 20 degrees
  const Vec3 own = ahead({0, 0, 0}, -1, row_of(camera, 1)), forward = row_of(camera, 2);
  const Vec3 seen = ahead(up, -dot(up, forward), forward);
  return dot(own, seen) < kHeldStraight * length(seen) ? up : own;
}

void state_view_of(const std::vector<l4d_camera>& cameras, double alone, const Vec3& up,
                   const std::function<double(const l4d_camera&)>& score,
                   l4d_presentation* presentation) {
  const l4d_camera& camera = best_of(cameras, up, score);
  const Vec3 eye = center_of(camera), forward = row_of(camera, 2);
  double spread = 0;
  for (const l4d_camera& other : cameras) {
    spread = std::max(spread, length(minus(center_of(other), eye)));
  }
  const double usual = spread > 0 ? spread / 2 : alone;
  const Vec3 point = point_of_axes(cameras, ahead(eye, usual, forward));
  const double depth = dot(minus(point, eye), forward);
  // Axes may meet behind cameras that look outwards.
  const double distance = std::max(depth > 0.05 * usual ? depth : usual, camera.near_plane);
  set_camera(eye, ahead(eye, distance, forward), upright(camera, up),
             2 * std::atan(camera.height / (2 * camera.fy)), presentation);
}

}  // namespace

void state_first_view(const std::vector<l4d_camera>& cameras, double alone,
                      l4d_presentation* presentation) {
  if (cameras.empty()) return;
  Vec3 middle{};
  for (const l4d_camera& camera : cameras) {
    middle = ahead(middle, 1 / static_cast<double>(cameras.size()), center_of(camera));
  }
  state_view_of(
      cameras, alone, common_up(cameras),
      [&](const l4d_camera& camera) { return -length(minus(center_of(camera), middle)); },
      presentation);
}

void state_first_view(const CameraSet& set, const Scene& scene, l4d_presentation* presentation,
                      const Hold& holder) {
  const std::shared_ptr<void> memory = hold(holder, subject_bytes(scene), "the first view");
  std::vector<l4d_camera> cameras, all;
  for (const Camera& camera : set.cameras) {
    all.push_back(camera.camera);
    if (camera.split == "train") cameras.push_back(camera.camera);
  }
  if (cameras.empty()) cameras = all;
  const std::optional<Subject> subject = visible_subject(scene);
  if (!subject) return state_first_view(cameras, 1, presentation);
  if (cameras.empty()) return;
  constexpr double kFree = 0.15;  // of the distance to the subject
  const SightGrid grid(scene, *subject);
  const Vec3 up = common_up(cameras);
  state_view_of(
      cameras, subject->radius, up,
      [&](const l4d_camera& camera) {
        const Vec3 eye = center_of(camera);
        const Vec3 way = minus(subject->center, eye);
        const double faces = length(way) > 0 ? dot(row_of(camera, 2), unit(way)) : 0;
        // The camera was there: what a model has close to it is haze that no image shows.
        const double free = kFree * length(way);
        // One that looks elsewhere shows it at the edge, or not at all.
        return faces < 0.5 ? faces - 1
                           : faces * grid.seen_from(eye, subject->center, row_of(camera, 1), free);
      },
      presentation);
}

void state_first_view(const Scene& scene, l4d_presentation* presentation, const Hold& holder) {
  const std::shared_ptr<void> memory = hold(holder, subject_bytes(scene), "the first view");
  const std::optional<Subject> visible = visible_subject(scene);
  if (!visible) return;
  const Subject& subject = *visible;
  const SightGrid grid(scene, subject);
  const Vec3& up = subject.up;
  const Vec3 across{1, 0, 0}, along = cross(up, across);
  const double fits = subject.radius / std::sin(kFov / 2);
  Vec3 best{};
  double most = -1;
  for (int k = 0; k < 16; ++k) {
    const double turn = k * 0.39269908169872414;
    const Vec3 level = ahead(ahead({0, 0, 0}, std::sin(turn), across), -std::cos(turn), along);
    // A side shows up to twice as much as a face.
    const double faces = std::pow(grid.symmetry(level, up), 4);
    for (const double distance :
         {fits, 0.7 * fits, 0.45 * fits, 0.9 * subject.radius, 0.5 * subject.radius}) {
      for (const double elevation : {0.15, 0.45}) {
        const Vec3 eye = ahead(ahead(subject.center, distance * std::cos(elevation), level),
                               distance * std::sin(elevation), up);
        const double seen = faces * grid.seen_from(eye, subject.center, up);
        if (seen <= most) continue;
        most = seen;
        best = eye;
      }
    }
  }
  set_camera(best, subject.center, up, kFov, presentation);
}

void copy_first_view(const l4d_presentation& from, l4d_presentation* presentation) {
  Vec3 eye, target, up;
  std::copy_n(from.camera_position, 3, eye.begin());
  std::copy_n(from.camera_target, 3, target.begin());
  std::copy_n(from.camera_up, 3, up.begin());
  set_camera(eye, target, up, from.camera_fov, presentation);
}

l4d_presentation turned(const l4d_presentation& presentation, double angle, double rise,
                        double zoom) {
  l4d_presentation out = presentation;
  Vec3 eye, target, up;
  std::copy_n(presentation.camera_position, 3, eye.begin());
  std::copy_n(presentation.camera_target, 3, target.begin());
  std::copy_n(presentation.camera_up, 3, up.begin());
  const Vec3 axis = unit(up), arm = minus(eye, target);
  const double along = dot(arm, axis), c = std::cos(angle), s = std::sin(angle);
  const Vec3 across = ahead(arm, -along, axis), beside = cross(axis, across);
  const double width = std::sqrt(dot(across, across)), length = std::hypot(width, along);
  const double before = std::atan2(along, width);
  // What looks along the pole stays there: across has no direction then.
  const double after = rise == 0 ? before : std::clamp(before + rise, -kSteepest, kSteepest);
  const double wider = width > 0 ? length * std::cos(after) / (width * zoom) : 0;
  const double higher = (width > 0 ? length * std::sin(after) : along) / zoom;
  const Vec3 at = ahead(ahead(ahead(target, higher, axis), wider * c, across), wider * s, beside);
  std::copy_n(at.begin(), 3, out.camera_position);
  return out;
}

void place(const Vec3& eye, const Vec3& forward, const Vec3& up, l4d_camera& camera) {
  const Vec3 right = unit(cross(forward, up)), down = cross(forward, right);
  double axes[9];
  for (size_t k = 0; k < 3; ++k) {
    axes[3 * k] = right[k];
    axes[3 * k + 1] = down[k];
    axes[3 * k + 2] = forward[k];
  }
  set_pose(camera, axes, eye.data());
}

l4d_camera camera_of(const l4d_presentation& p, uint32_t width, uint32_t height) {
  Vec3 eye, target, up;
  std::copy_n(p.camera_position, 3, eye.begin());
  std::copy_n(p.camera_target, 3, target.begin());
  std::copy_n(p.camera_up, 3, up.begin());
  l4d_camera camera = default_camera();
  camera.width = width;
  camera.height = height;
  camera.fx = camera.fy = 0.5 * static_cast<double>(height) / std::tan(p.camera_fov / 2);
  camera.cx = 0.5 * static_cast<double>(width);
  camera.cy = 0.5 * static_cast<double>(height);
  camera.near_plane = std::min(camera.near_plane, 0.01 * length(minus(target, eye)));
  place(eye, unit(minus(target, eye)), up, camera);
  return camera;
}

}  // namespace l4d::io
