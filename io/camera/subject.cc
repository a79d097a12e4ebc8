// SPDX-License-Identifier: Apache-2.0
#include "io/camera/subject.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <utility>

#include "libl4dcodec/scene/slice.h"

namespace l4d::io {
namespace {

constexpr double kBallShare = 0.9;
// Dense are cells with half as much opacity as those have with which this share of it is reached,
// the fullest first; in a grid with so many Gaussians a cell on average.
constexpr double kFullestShare = 0.2, kPerCell = 8;
constexpr size_t kMostCells = 64;  // a side

struct Point {
  Vec3 at;
  double weight;
};

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

double quantile(const std::vector<Point>& points, double share,
                const std::function<double(const Vec3&)>& value) {
  std::vector<Weighted> values;
  values.reserve(points.size());
  for (const Point& point : points) values.emplace_back(value(point.at), point.weight);
  return weighted_quantile(std::move(values), share);
}

std::vector<Point> visible_points(const Scene& scene) {
  const std::vector<float> position = visible_positions(scene);
  const bool is_logit = (scene.flags & L4D_OPACITY_LOGIT) != 0;
  std::vector<Point> points;
  for (size_t i = 0; i < scene.count(); ++i) {
    Point p;
    p.weight = linear_opacity(static_cast<double>(scene.opacity[i]), is_logit);
    bool usable = p.weight > 0 && std::isfinite(p.weight);
    for (size_t k = 0; k < 3; ++k) {
      p.at[k] = static_cast<double>(position[3 * i + k]);
      usable = usable && std::isfinite(p.at[k]);
    }
    if (usable) points.push_back(p);
  }
  return points;
}

// Around the median: its ball, and how far 90 % extend along each axis.
Subject ball_of(const std::vector<Point>& points, Vec3* spread) {
  Subject ball;
  for (size_t k = 0; k < 3; ++k) {
    ball.center[k] = quantile(points, 0.5, [&](const Vec3& p) { return p[k]; });
  }
  const Vec3& c = ball.center;
  for (size_t k = 0; k < 3; ++k) {
    (*spread)[k] =
        quantile(points, kBallShare, [&](const Vec3& p) { return std::abs(p[k] - c[k]); });
  }
  ball.radius = quantile(points, kBallShare, [&](const Vec3& p) {
    return std::hypot(p[0] - c[0], p[1] - c[1], p[2] - c[2]);
  });
  if (!(ball.radius > 0)) ball.radius = 1;  // all in one point
  return ball;
}

// Those of the points in the ball that lie in its fullest cells.
std::vector<Point> dense_points(const std::vector<Point>& points, const Subject& ball) {
  const double side = std::cbrt(static_cast<double>(points.size()) / kPerCell);
  const size_t n = std::clamp<size_t>(static_cast<size_t>(side), 1, kMostCells);
  std::vector<double> cells(n * n * n);
  const auto cell_of = [&](const Vec3& p) {
    size_t cell = 0;
    for (size_t k = 0; k < 3; ++k) {
      const double x = ((p[k] - ball.center[k]) / ball.radius + 1) / 2 * static_cast<double>(n);
      if (!(x >= 0 && x < static_cast<double>(n))) return cells.size();
      cell = cell * n + static_cast<size_t>(x);
    }
    return cell;
  };
  double total = 0;
  for (const Point& p : points) {
    const size_t cell = cell_of(p.at);
    if (cell == cells.size()) continue;
    cells[cell] += p.weight;
    total += p.weight;
  }
  std::vector<double> fullest = cells;
  std::sort(fullest.begin(), fullest.end(), std::greater<>());
  double sum = 0;
  size_t last = 0;
  while (last + 1 < fullest.size() && (sum += fullest[last]) < kFullestShare * total) ++last;
  std::vector<Point> dense;
  for (const Point& p : points) {
    const size_t cell = cell_of(p.at);
    if (cell < cells.size() && 2 * cells[cell] >= fullest[last]) dense.push_back(p);
  }
  return dense;
}

Subject ball_of_bounds(const l4d_presentation& presentation, Vec3* spread) {
  Subject ball;
  double squared = 0;
  for (size_t k = 0; k < 3; ++k) {
    ball.center[k] = (presentation.bounds_min[k] + presentation.bounds_max[k]) / 2;
    (*spread)[k] = (presentation.bounds_max[k] - presentation.bounds_min[k]) / 2;
    squared += (*spread)[k] * (*spread)[k];
  }
  ball.radius = squared > 0 ? std::sqrt(squared) : 1;
  return ball;
}

}  // namespace

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

Subject subject_of(const Scene& scene) {
  const std::vector<Point> points = visible_points(scene);
  if (points.empty()) {
    throw Error(L4D_ERR_INVALID_SCENE, "no Gaussian is visible: there is nothing to look at");
  }
  Vec3 spread{};
  Subject subject;
  if (scene.presentation.has_bounds != 0) {
    subject = ball_of_bounds(scene.presentation, &spread);
  } else {
    subject = ball_of(points, &spread);
    Vec3 unused;
    const Subject dense = ball_of(dense_points(points, subject), &unused);
    subject.center = dense.center;
    subject.radius = dense.radius;
  }
  subject.up_axis = 2 * spread[2] < spread[1] ? 2 : 1;
  const uint32_t coordinates = scene.placement.coordinate_system;
  subject.up_sign = subject.up_axis == 2 || coordinates == L4D_COORDINATES_RIGHT_UP_BACK ? 1 : -1;
  return subject;
}

}  // namespace l4d::io
