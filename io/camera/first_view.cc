// SPDX-License-Identifier: Apache-2.0
#include "io/camera/first_view.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <optional>
#include <utility>

#include "io/camera/read_cameras.h"
#include "io/camera/subject.h"
#include "io/scene/rotor_math.h"
#include "libl4dcodec/scene/slice.h"

namespace l4d::io {
namespace {

double length(const Vec3& a) { return std::sqrt(dot(a, a)); }
Vec3 ahead(const Vec3& a, double s, const Vec3& b) {  // a + s b
  return {a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]};
}
Vec3 minus(const Vec3& a, const Vec3& b) { return ahead(a, -1, b); }
Vec3 unit(const Vec3& a) { return ahead({0, 0, 0}, 1 / length(a), a); }

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

constexpr size_t kCells = 48;  // a side of the grid, which reaches to twice the radius
constexpr double kReach = 2;
constexpr double kFov = 0.8727;       // 50 degrees, of the height
constexpr double kConeCosine = 0.89;  // 27 degrees: what is well within the image
constexpr double kDenseShare = 0.6;   // of the opacity in the ball of the subject

// What stands where: of each cell how much it hides, and how much it shows.
class Grid {
 public:
  Grid(const Scene& scene, const Subject& subject)
      : subject_(subject),
        cell_(2 * kReach * subject.radius / static_cast<double>(kCells)),
        depth_(kCells * kCells * kCells),
        weight_(depth_.size()) {
    const std::vector<float> position = visible_positions(scene);
    const bool is_logit = (scene.flags & L4D_OPACITY_LOGIT) != 0;
    for (size_t i = 0; i < scene.count(); ++i) {
      Vec3 p;
      for (size_t k = 0; k < 3; ++k) p[k] = static_cast<double>(position[3 * i + k]);
      const size_t cell = cell_of(p);
      const double opacity = linear_opacity(static_cast<double>(scene.opacity[i]), is_logit);
      if (cell == depth_.size() || !(opacity > 0 && opacity <= 1)) continue;
      weight_[cell] += opacity;
      hide(p, opacity, area_of(scene, i) / (cell_ * cell_));
    }
    find_dense();
  }

  // How much of the dense parts is seen from `eye` in the direction of the subject, times how much
  // of the image is free of what is close to the eye. up: not parallel to that direction.
  double seen_from(const Vec3& eye, const Vec3& up) const {
    const Vec3 forward = unit(minus(subject_.center, eye));
    const double clear = clear_from(eye, forward, up);
    double sum = 0;
    for (const auto& [at, weight] : dense_) {
      const Vec3 way = minus(eye, at);
      const double distance = length(way);
      // What is nearer than a quarter of the radius fills the image and shows nothing.
      if (distance < subject_.radius / 4 || -dot(way, forward) < kConeCosine * distance) continue;
      sum += weight * std::exp(-depth_between(at, way, distance));
    }
    return sum * clear;
  }

  // How much of the subject is the same on both sides of the upright plane through it that `level`
  // lies in, from 0 to 1: statues and people have such a plane, and face along it.
  double symmetry(const Vec3& level, const Vec3& up) const {
    constexpr int kShifts = 4;  // to both sides, of a twentieth of the radius each
    const Vec3 across = cross(up, level);
    double most = 0;
    for (int shift = -kShifts; shift <= kShifts; ++shift) {
      double same = 0, all = 0;
      for (size_t cell = 0; cell < weight_.size(); ++cell) {
        if (weight_[cell] == 0) continue;
        const Vec3 at = middle_of(cell), from = minus(at, subject_.center);
        if (length(from) > 1.1 * subject_.radius) continue;
        const double side = dot(from, across) - 0.05 * shift * subject_.radius;
        const size_t other = cell_of(ahead(at, -2 * side, across));
        if (other < weight_.size()) same += std::sqrt(weight_[cell] * weight_[other]);
        all += weight_[cell];
      }
      if (all > 0) most = std::max(most, same / all);
    }
    return most;
  }

 private:
  // Of 7 x 5 directions of the image, half of the way to the subject.
  double clear_from(const Vec3& eye, const Vec3& forward, const Vec3& up) const {
    constexpr double kStep = 0.18;  // tangent: the outermost are 28 and 20 degrees off the axis
    const Vec3 right = unit(cross(forward, up)), down = cross(forward, right);
    const double distance = length(minus(subject_.center, eye)) / 2;
    double sum = 0;
    for (int k = 0; k < 35; ++k) {
      const Vec3 way =
          unit(ahead(ahead(forward, kStep * (k % 7 - 3), right), kStep * (k / 7 - 2), down));
      double depth = 0;
      for (double s = 0; s <= distance; s += cell_) {
        const size_t cell = cell_of(ahead(eye, s, way));
        if (cell < depth_.size()) depth += depth_[cell];
      }
      sum += std::exp(-depth);
    }
    return sum / 35;
  }

  size_t cell_of(const Vec3& p) const {
    size_t cell = 0;
    for (size_t k = 0; k < 3; ++k) {
      const double x = (p[k] - subject_.center[k]) / cell_ + static_cast<double>(kCells) / 2;
      if (!(x >= 0 && x < static_cast<double>(kCells))) return depth_.size();
      cell = cell * kCells + static_cast<size_t>(x);
    }
    return cell;
  }
  // A Gaussian hides its cell, or as it does not fit in there a block of cells, three deep.
  void hide(const Vec3& p, double opacity, double share) {
    if (share <= 1) {
      depth_[cell_of(p)] += opacity * share;
      return;
    }
    const double each = opacity * std::min(1.0, share / 9) / 3;
    for (int k = 0; k < 27; ++k) {
      const Vec3 at{p[0] + (k / 9 - 1) * cell_, p[1] + (k / 3 % 3 - 1) * cell_,
                    p[2] + (k % 3 - 1) * cell_};
      const size_t cell = cell_of(at);
      if (cell < depth_.size()) depth_[cell] += each;
    }
  }
  Vec3 middle_of(size_t cell) const {
    const size_t index[3] = {cell / (kCells * kCells), cell / kCells % kCells, cell % kCells};
    Vec3 p;
    for (size_t k = 0; k < 3; ++k) {
      p[k] = subject_.center[k] +
             (static_cast<double>(index[k]) + 0.5 - static_cast<double>(kCells) / 2) * cell_;
    }
    return p;
  }
  void find_dense() {
    std::vector<size_t> order;
    double total = 0, sum = 0;
    for (size_t cell = 0; cell < weight_.size(); ++cell) {
      if (weight_[cell] == 0) continue;
      if (length(minus(middle_of(cell), subject_.center)) > subject_.radius) continue;
      order.push_back(cell);
      total += weight_[cell];
    }
    std::stable_sort(order.begin(), order.end(),
                     [&](size_t a, size_t b) { return weight_[a] > weight_[b]; });
    for (size_t k = 0; k < order.size() && sum < kDenseShare * total; ++k) {
      sum += weight_[order[k]];
      dense_.emplace_back(middle_of(order[k]), weight_[order[k]]);
    }
  }
  // Optical depth on the way, but for the cells of `at` and next to it.
  double depth_between(const Vec3& at, const Vec3& way, double distance) const {
    double depth = 0;
    for (double s = 1.5 * cell_; s <= distance; s += cell_) {
      const size_t cell = cell_of(ahead(at, s / distance, way));
      if (cell == depth_.size()) break;
      depth += depth_[cell];
    }
    return depth;
  }

  Subject subject_;
  double cell_;
  std::vector<double> depth_, weight_;
  std::vector<std::pair<Vec3, double>> dense_;
};

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

void state_first_view(const CameraSet& set, const Scene& scene, l4d_presentation* presentation) {
  std::vector<l4d_camera> cameras, all;
  for (const Camera& camera : set.cameras) {
    all.push_back(camera.camera);
    if (camera.split == "train") cameras.push_back(camera.camera);
  }
  if (cameras.empty()) cameras = all;
  const std::optional<Subject> subject = visible_subject(scene);
  if (!subject) return state_first_view(cameras, 1, presentation);
  if (cameras.empty()) return;
  const Grid grid(scene, *subject);
  const Vec3 up = common_up(cameras);
  state_view_of(
      cameras, subject->radius, up,
      [&](const l4d_camera& camera) {
        const Vec3 eye = center_of(camera);
        const Vec3 way = minus(subject->center, eye);
        const double faces = length(way) > 0 ? dot(row_of(camera, 2), unit(way)) : 0;
        // One that looks elsewhere shows it at the edge, or not at all.
        return faces < 0.5 ? faces - 1 : faces * grid.seen_from(eye, row_of(camera, 1));
      },
      presentation);
}

void state_first_view(const Scene& scene, l4d_presentation* presentation) {
  const std::optional<Subject> visible = visible_subject(scene);
  if (!visible) return;
  const Subject& subject = *visible;
  const Grid grid(scene, subject);
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
        const double seen = faces * grid.seen_from(eye, up);
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

l4d_presentation turned(const l4d_presentation& presentation, double angle) {
  l4d_presentation out = presentation;
  Vec3 eye, target, up;
  std::copy_n(presentation.camera_position, 3, eye.begin());
  std::copy_n(presentation.camera_target, 3, target.begin());
  std::copy_n(presentation.camera_up, 3, up.begin());
  const Vec3 axis = unit(up), arm = minus(eye, target);
  const double along = dot(arm, axis), c = std::cos(angle), s = std::sin(angle);
  const Vec3 across = ahead(arm, -along, axis), beside = cross(axis, across);
  const Vec3 at = ahead(ahead(ahead(target, along, axis), c, across), s, beside);
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
