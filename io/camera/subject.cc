// SPDX-License-Identifier: Apache-2.0
#include "io/camera/subject.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numeric>
#include <optional>
#include <utility>

#include "io/camera/vectors.h"
#include "libl4dcodec/scene/slice.h"

namespace l4d::io {
namespace {

constexpr double kBallShare = 0.9;
// Dense are cells with half as much opacity as those have with which this share of it is reached,
// the fullest first; in a grid with so many Gaussians a cell on average.
constexpr double kFullestShare = 0.2, kPerCell = 8;
constexpr size_t kMostCells = 64;  // a side

// The foot of a scene: surface at most as far away as kNear radii, and of one Gaussian at most a
// square of a quarter of one; more of it in the lowest quarter of the height than in the highest.
constexpr double kNear = 1.5, kBroadest = 0.25, kEnd = 0.02;
// Of axes, z has a foot only if it is so much clearer than that of y, which is what most scenes
// have; an axis whose ends differ by less than kLeastFoot has none.
constexpr double kClearer = 0.15, kLeastFoot = 0.1;

// What moves or does not stay is looked at, where there is enough of it to see, and not all of the
// scene is so: shares of the opacity. It stays if it fades with more than a quarter of the sequence
// as its standard deviation, and moves if it goes further than a twentieth of the radius meanwhile.
constexpr double kLeastAction = 0.02, kMostAction = 0.7, kStays = 0.25, kMoves = 0.05;
constexpr double kSmallestAction = 0.2;  // of the radius of all
constexpr double kAround = 2;            // radii of what is dense of it

struct Point {
  Vec3 at;
  double weight;   // opacity times window_share
  double surface;  // weight times area
  bool stays = true;
  double speed = 0;  // scene units per sequence
};

using Weighted = std::pair<double, double>;  // value, weight

// The smallest value up to which `share` of the weight lies.
double weighted_quantile(std::vector<Weighted> values, double share) {
  const auto weight_of = [](auto begin, auto end) {
    return std::accumulate(begin, end, 0.0,
                           [](double sum, const Weighted& value) { return sum + value.second; });
  };
  double wanted = share * weight_of(values.begin(), values.end());
  // Halves the range in which it lies: sorting all of it takes ten times as long.
  auto first = values.begin(), last = values.end();
  while (last - first > 1) {
    const auto middle = first + (last - first) / 2;
    std::nth_element(first, middle, last);
    const double below = weight_of(first, middle);
    if (below >= wanted) {
      last = middle;
    } else {
      wanted -= below;
      first = middle;
    }
  }
  return first->first;
}

double quantile(const std::vector<Point>& points, double share,
                const std::function<double(const Vec3&)>& value) {
  std::vector<Weighted> values;
  values.reserve(points.size());
  for (const Point& point : points) values.emplace_back(value(point.at), point.weight);
  return weighted_quantile(std::move(values), share);
}

void state_motion(const Scene& scene, size_t i, Point* p) {
  if (scene.rotor.empty() || scene.mean_t.empty()) return;  // an instant
  Rotor rotor;
  Vec4 scale;
  for (size_t k = 0; k < 8; ++k) rotor[k] = static_cast<double>(scene.rotor[8 * i + k]);
  for (size_t k = 0; k < 4; ++k) {
    scale[k] = std::exp(static_cast<double>(scene.log_scale[4 * i + k]));
  }
  const Matrix4 axes = rotor_to_matrix(rotor);
  double variance = 0;
  for (size_t k = 0; k < 4; ++k) variance += axes[12 + k] * axes[12 + k] * scale[k] * scale[k];
  const double whole = duration(scene.timeline);
  const double share = window_share(scene, i);
  const double stay = share < 1 ? share * whole / 2 : std::sqrt(variance);
  p->stays = !(stay <= kStays * whole);
  p->speed = length(velocity_of(rotor, scale)) * whole;
}

std::vector<Point> visible_points(const Scene& scene, bool with_motion) {
  const std::vector<float> position = visible_positions(scene);
  const bool is_logit = (scene.flags & L4D_OPACITY_LOGIT) != 0;
  std::vector<Point> points;
  points.reserve(scene.count());
  for (size_t i = 0; i < scene.count(); ++i) {
    Point p;
    p.weight = linear_opacity(static_cast<double>(scene.opacity[i]), is_logit);
    bool usable = p.weight > 0 && std::isfinite(p.weight);
    for (size_t k = 0; k < 3; ++k) {
      p.at[k] = static_cast<double>(position[3 * i + k]);
      usable = usable && std::isfinite(p.at[k]);
    }
    p.weight *= window_share(scene, i);
    p.surface = p.weight * area_of(scene, i);
    if (usable && with_motion) state_motion(scene, i, &p);
    if (usable) points.push_back(p);
  }
  return points;
}

// Around the median: the ball that holds kBallShare.
Subject ball_of(const std::vector<Point>& points) {
  Subject ball;
  for (size_t k = 0; k < 3; ++k) {
    ball.center[k] = quantile(points, 0.5, [&](const Vec3& p) { return p[k]; });
  }
  const Vec3& c = ball.center;
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

// Where something happens, in a scene that is mostly at rest.
std::optional<Subject> action_of(const std::vector<Point>& points, const Subject& all) {
  std::vector<Point> acting;
  double total = 0, sum = 0;
  for (const Point& p : points) {
    total += p.weight;
    if (p.stays && p.speed <= kMoves * all.radius) continue;
    acting.push_back(p);
    sum += p.weight;
  }
  if (acting.empty() || !(sum >= kLeastAction * total && sum <= kMostAction * total)) {
    return std::nullopt;
  }
  Subject action = ball_of(dense_points(acting, ball_of(acting)));
  // Whole, and not its densest parts alone: of people these are the legs.
  const auto is_far = [&](const Point& p) {
    return length(minus(p.at, action.center)) > kAround * action.radius;
  };
  acting.erase(std::remove_if(acting.begin(), acting.end(), is_far), acting.end());
  action = ball_of(acting);
  if (!(action.radius < all.radius)) return std::nullopt;
  action.radius = std::max(action.radius, kSmallestAction * all.radius);
  return action;
}

Subject ball_of_bounds(const l4d_presentation& presentation) {
  Subject ball;
  double squared = 0;
  for (size_t k = 0; k < 3; ++k) {
    ball.center[k] = (presentation.bounds_min[k] + presentation.bounds_max[k]) / 2;
    const double half = (presentation.bounds_max[k] - presentation.bounds_min[k]) / 2;
    squared += half * half;
  }
  ball.radius = squared > 0 ? std::sqrt(squared) : 1;
  return ball;
}

// How much broader the subject is at its low end along an axis than at its high one, from -1 to 1.
double foot_of(const std::vector<Point>& points, const Subject& subject, size_t axis) {
  const double broadest = kBroadest * kBroadest * subject.radius * subject.radius;
  std::vector<Weighted> heights;
  for (const Point& p : points) {
    const Vec3& c = subject.center;
    if (std::hypot(p.at[0] - c[0], p.at[1] - c[1], p.at[2] - c[2]) > kNear * subject.radius) {
      continue;
    }
    heights.emplace_back(p.at[axis], std::min(p.surface, p.weight * broadest));
  }
  if (heights.empty()) return 0;
  const double low = weighted_quantile(heights, kEnd), high = weighted_quantile(heights, 1 - kEnd);
  double below = 0, above = 0;
  for (const auto& [height, surface] : heights) {
    if (height < low + (high - low) / 4) below += surface;
    if (height > high - (high - low) / 4) above += surface;
  }
  return below + above > 0 ? (below - above) / (below + above) : 0;
}

Vec3 up_of(const std::vector<Point>& points, const Subject& subject, uint32_t coordinates) {
  if (coordinates == L4D_COORDINATES_RIGHT_UP_BACK) return {0, 1, 0};
  if (coordinates == L4D_COORDINATES_RIGHT_DOWN_FORWARD) return {0, -1, 0};
  const double y = foot_of(points, subject, 1), z = foot_of(points, subject, 2);
  if (std::abs(z) > std::max(std::abs(y) + kClearer, kLeastFoot)) return {0, 0, z > 0 ? 1.0 : -1.0};
  return {0, y > kLeastFoot ? 1.0 : -1.0, 0};
}

// whole: whatever moves.
Subject find_subject(const Scene& scene, bool whole) {
  const bool has_bounds = scene.presentation.has_bounds != 0;
  const std::vector<Point> points = visible_points(scene, !has_bounds && !whole);
  if (points.empty()) {
    throw Error(L4D_ERR_INVALID_SCENE, "no Gaussian is visible: there is nothing to look at");
  }
  Subject subject = has_bounds ? ball_of_bounds(scene.presentation) : ball_of(points);
  // What it stands on is not dense: it counts before the rest is left out.
  subject.up = up_of(points, subject, scene.placement.coordinate_system);
  if (!has_bounds) {
    Subject dense = ball_of(dense_points(points, subject));
    const std::optional<Subject> action = whole ? std::nullopt : action_of(points, dense);
    if (action) dense = *action;
    subject.center = dense.center;
    subject.radius = dense.radius;
  }
  return subject;
}

}  // namespace

double window_share(const Scene& scene, size_t i) {
  if (scene.window.empty() || scene.window[2 * i] >= scene.window[2 * i + 1]) return 1;
  const uint32_t frames = scene.window[2 * i + 1] - scene.window[2 * i];
  return std::min(1.0, static_cast<double>(frames) / scene.timeline.num_frames);
}

double area_of(const Scene& scene, size_t i) {
  if (scene.log_scale.empty()) return 0;
  Vec3 size;
  for (size_t k = 0; k < 3; ++k) {
    size[k] = std::exp(static_cast<double>(scene.log_scale[4 * i + k]));
  }
  std::sort(size.begin(), size.end());
  const double area = 6.283185307179586 * size[1] * size[2];
  return std::isfinite(area) ? area : 0;
}

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

uint64_t subject_bytes(const Scene& scene) {
  // A Gaussian's point among all, those that act and those that are dense, and the numbers that a
  // quantile is of; or copies of what decides where it is seen, and the cells of the grid.
  constexpr uint64_t kPoints = 3 * sizeof(Point) + sizeof(Weighted);
  constexpr uint64_t kCopies = (3 + 1 + 4 + 8) * sizeof(float) + sizeof(double) + 8;
  constexpr uint64_t kGrid = 6 << 20;
  return std::max(scene.count() * kPoints, scene.count() * kCopies + kGrid);
}

Subject subject_of(const Scene& scene) { return find_subject(scene, false); }

Subject whole_subject_of(const Scene& scene) { return find_subject(scene, true); }

}  // namespace l4d::io
