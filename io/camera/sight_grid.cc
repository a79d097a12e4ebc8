// SPDX-License-Identifier: Apache-2.0
#include "io/camera/sight_grid.h"

#include <algorithm>
#include <cmath>

#include "io/camera/vectors.h"
#include "libl4dcodec/scene/slice.h"

namespace l4d::io {
namespace {

constexpr size_t kCells = 60;         // a side of the grid
constexpr double kReach = 2.5;        // radii: to where a ball is seen from that fills the image
constexpr double kConeCosine = 0.89;  // 27 degrees: what is well within the image
constexpr double kDenseShare = 0.6;   // of the opacity in the ball of the subject

}  // namespace

SightGrid::SightGrid(const Scene& scene, const Subject& subject)
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
    const double shown = opacity * window_share(scene, i);
    weight_[cell] += shown;
    hide(p, shown, area_of(scene, i) / (cell_ * cell_));
  }
  find_dense();
}

double SightGrid::seen_from(const Vec3& eye, const Vec3& target, const Vec3& up,
                            double free) const {
  const Vec3 forward = unit(minus(target, eye));
  const double clear = clear_from(eye, target, up, free);
  double sum = 0;
  for (const auto& [at, weight] : dense_) {
    const Vec3 way = minus(eye, at);
    const double distance = length(way);
    // What is nearer than a quarter of the radius fills the image and shows nothing.
    if (distance < subject_.radius / 4 || -dot(way, forward) < kConeCosine * distance) continue;
    sum += weight * std::exp(-depth_between(at, unit(way), distance - free));
  }
  return sum * clear;
}

double SightGrid::symmetry(const Vec3& level, const Vec3& up) const {
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

// Of 7 x 5 directions of the image, half of the way to the target.
double SightGrid::clear_from(const Vec3& eye, const Vec3& target, const Vec3& up,
                             double free) const {
  constexpr double kStep = 0.18;  // tangent: the outermost are 28 and 20 degrees off the axis
  const Vec3 forward = unit(minus(target, eye));
  const Vec3 right = unit(cross(forward, up)), down = cross(forward, right);
  const double distance = length(minus(target, eye)) / 2;
  double sum = 0;
  for (int k = 0; k < 35; ++k) {
    const Vec3 way =
        unit(ahead(ahead(forward, kStep * (k % 7 - 3), right), kStep * (k / 7 - 2), down));
    double depth = 0;
    for (double s = free; s <= distance; s += cell_) {
      const size_t cell = cell_of(ahead(eye, s, way));
      if (cell < depth_.size()) depth += depth_[cell];
    }
    sum += std::exp(-depth);
  }
  return sum / 35;
}

size_t SightGrid::cell_of(const Vec3& p) const {
  size_t cell = 0;
  for (size_t k = 0; k < 3; ++k) {
    const double x = (p[k] - subject_.center[k]) / cell_ + static_cast<double>(kCells) / 2;
    if (!(x >= 0 && x < static_cast<double>(kCells))) return depth_.size();
    cell = cell * kCells + static_cast<size_t>(x);
  }
  return cell;
}

// A Gaussian hides its cell, or as it does not fit in there a block of cells, three deep.
void SightGrid::hide(const Vec3& p, double opacity, double share) {
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

Vec3 SightGrid::middle_of(size_t cell) const {
  const size_t index[3] = {cell / (kCells * kCells), cell / kCells % kCells, cell % kCells};
  Vec3 p;
  for (size_t k = 0; k < 3; ++k) {
    p[k] = subject_.center[k] +
           (static_cast<double>(index[k]) + 0.5 - static_cast<double>(kCells) / 2) * cell_;
  }
  return p;
}

void SightGrid::find_dense() {
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

// Optical depth so far along the way, a direction, but for the cells of `at` and next to it.
double SightGrid::depth_between(const Vec3& at, const Vec3& way, double distance) const {
  double depth = 0;
  for (double s = 1.5 * cell_; s <= distance; s += cell_) {
    const size_t cell = cell_of(ahead(at, s, way));
    if (cell == depth_.size()) break;
    depth += depth_[cell];
  }
  return depth;
}

}  // namespace l4d::io
