// SPDX-License-Identifier: Apache-2.0
#include "encoder/position_plan.h"

#include <algorithm>
#include <cmath>

#include "libl4dcodec/container/scene_header.h"

namespace l4d {
namespace {

// A picture shows the scene about this many pixels wide: errors of half of one are not seen.
constexpr double kSizesPerExtent = 4000;
// The box of the scene is that of all Gaussians but this share on each side of each axis, and a
// little more: a floater in twenty is not taken for the scene.
constexpr double kTail = 0.05;
constexpr double kBeyondTails = 1.25;
// Rounding of coordinates may use up this share of what positions may be off by.
constexpr double kRoundingShare = 0.5;
constexpr unsigned kMaxOpacityBits = 16;
// More Gaussians than this share are not left out of reach for the sake of a finer step.
constexpr double kMaxOutOfReach = 0.01;
// A little room for positions that move when they are fitted to coded velocities.
constexpr double kReachUsed = 0.96;

// Coordinates k of all Gaussians, in order.
std::vector<double> sorted_axis(const EncoderScene& s, size_t k) {
  std::vector<double> axis(s.count);
  for (size_t i = 0; i < s.count; ++i) axis[i] = s.position[3 * i + k];
  std::sort(axis.begin(), axis.end());
  return axis;
}

// Where the window of `width` begins that is centred on the middle of the scene, or where it can
// begin to hold all of it.
double window_begin(const std::vector<double>& axis, double width) {
  if (axis.back() - axis.front() <= width) return (axis.front() + axis.back() - width) / 2;
  return axis[axis.size() / 2] - width / 2;
}

// Gaussians that a window of `width` on each axis does not hold.
std::vector<uint32_t> outside(const EncoderScene& s, const std::vector<double> (&axes)[3],
                              double width) {
  double low[3];
  for (size_t k = 0; k < 3; ++k) low[k] = window_begin(axes[k], width);
  std::vector<uint32_t> out;
  for (uint32_t i = 0; i < s.count; ++i) {
    bool in = true;
    for (size_t k = 0; k < 3; ++k) {
      const double x = s.position[3 * size_t{i} + k] - low[k];
      in = in && x >= 0 && x <= width;
    }
    if (!in) out.push_back(i);
  }
  return out;
}

double extent_of(const std::vector<double>& axis) {
  const size_t tail = static_cast<size_t>(kTail * static_cast<double>(axis.size()));
  const double most = axis[axis.size() - 1 - tail] - axis[tail];
  return std::min(kBeyondTails * most, axis.back() - axis.front());
}

// The smallest size of a Gaussian that counts: a third of the trace is no more than the largest
// variance.
double smallest_size(const EncoderScene& s, double least_size) {
  double smallest = HUGE_VAL;
  for (size_t i = 0; i < s.count; ++i) {
    const SeenGaussian g = s.seen(i);
    const double trace = g.covariance[0] + g.covariance[3] + g.covariance[5];
    smallest = std::min(smallest, std::max({std::sqrt(trace / 3), least_size, g.least_size}));
  }
  return smallest;
}

}  // namespace

double scene_extent(const EncoderScene& scene) {
  double extent = 0;
  for (size_t k = 0; k < 3; ++k) extent = std::max(extent, extent_of(sorted_axis(scene, k)));
  return extent;
}

ErrorBounds declared_bounds(const EncoderScene& scene, const EncoderSettings& settings) {
  ErrorBounds b;
  if (settings.get_bool(L4D_ENC_LOSSLESS)) return b;
  b.position = settings.get(L4D_ENC_MAX_POSITION_ERROR);
  b.covariance = settings.get(L4D_ENC_MAX_COVARIANCE_FACTOR);
  b.opacity = settings.get(L4D_ENC_MAX_OPACITY_ERROR);
  b.visible = settings.get(L4D_ENC_MAX_VISIBLE_ERROR);
  b.least_size = scene_extent(scene) / kSizesPerExtent;
  return b;
}

PositionPlan plan_positions(const EncoderScene& scene, const EncoderSettings& settings,
                            const Quality& quality, ErrorBounds* bounds) {
  PositionPlan plan;
  plan.opacity_bits = quality.opacity_bits();
  const auto half_step = [](unsigned bits) { return 0.5 / ((1u << bits) - 1); };
  if (settings.get_int(L4D_ENC_OPACITY_BITS) == 0) {
    while (bounds->opacity > 0 && plan.opacity_bits < kMaxOpacityBits &&
           half_step(plan.opacity_bits) > kRoundingShare * bounds->opacity) {
      ++plan.opacity_bits;
    }
  }
  bounds->opacity_slack = half_step(plan.opacity_bits);
  if (!settings.get_bool(L4D_ENC_FIXED_POSITIONS)) return plan;
  double importance = 0;
  for (const float w : scene.position_importance) importance += static_cast<double>(w);
  const double wanted = quality.position_step(importance);
  // The step whose rounding, half a diagonal, takes the share that it may of each bound.
  double coarsest = HUGE_VAL;
  const auto allow = [&](double error) {
    if (error > 0) coarsest = std::min(coarsest, kRoundingShare * error * 2 / std::sqrt(3.0));
  };
  if (bounds->position > 0) {
    allow(bounds->position * smallest_size(scene, bounds->least_size));
  }
  allow(bounds->visible);
  plan.step = std::min(wanted, coarsest);

  std::vector<double> axes[3];
  for (size_t k = 0; k < 3; ++k) axes[k] = sorted_axis(scene, k);
  const double reach = kReachUsed * static_cast<double>((1u << kMaxPositionBits) - 2);
  // Without a bound, what a bound of half a size would ask for is fine enough.
  const double enough =
      std::min(coarsest, 0.5 * kRoundingShare * bounds->least_size * 2 / std::sqrt(3.0));
  plan.out_of_reach = outside(scene, axes, reach * plan.step);
  const double most = kMaxOutOfReach * static_cast<double>(scene.count);
  while (static_cast<double>(plan.out_of_reach.size()) > most && plan.step < enough) {
    plan.step = std::min(2 * plan.step, enough);
    plan.out_of_reach = outside(scene, axes, reach * plan.step);
  }
  bounds->position_slack = plan.step * std::sqrt(3.0) / 2;
  return plan;
}

}  // namespace l4d
