// SPDX-License-Identifier: Apache-2.0
#include "encoder/plan/positions.h"

#include <algorithm>
#include <cmath>

#include "encoder/prepare/scalar.h"
#include "libl4dcodec/container/scene_header.h"

namespace l4d {
namespace {

// A picture shows the scene about this many pixels wide: errors of half of one are not seen.
constexpr double kSizesPerExtent = 4000;
// Rounding of coordinates may use up this share of what positions may be off by: how each is
// rounded is known when its shape is coded, and few Gaussians are as small as the smallest.
constexpr double kPositionRounding = 0.9;
// Where they are rounded later, the worst has to be allowed for.
constexpr double kLateRounding = 0.5;
constexpr double kOpacityRounding = 0.5;
constexpr unsigned kMaxOpacityBits = 16;
// More Gaussians than this share are not left out of reach for the sake of a finer step.
constexpr double kMaxOutOfReach = 0.01;
// A little room for positions that move when they are fitted to coded velocities.
constexpr double kReachUsed = 0.96;

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

// The smallest size of a Gaussian that counts: a third of the trace is no more than the largest
// variance.
double smallest_size(const EncoderScene& s, double min_size) {
  double smallest = HUGE_VAL;
  for (size_t i = 0; i < s.count; ++i) {
    const SeenGaussian g = s.seen(i);
    const double trace = g.covariance[0] + g.covariance[3] + g.covariance[5];
    smallest = std::min(smallest, std::max({std::sqrt(trace / 3), min_size, g.min_size}));
  }
  return smallest;
}

// Where coordinates count from, so that all in reach are there wherever their bounds let them be.
void choose_lattice(const EncoderScene& s, const std::vector<double> (&axes)[3],
                    const ErrorBounds& bounds, PositionPlan* plan) {
  double low[3], high[3];
  std::fill_n(low, 3, HUGE_VAL);
  std::fill_n(high, 3, -HUGE_VAL);
  for (uint32_t i = 0; i < s.count; ++i) {
    if (std::binary_search(plan->out_of_reach.begin(), plan->out_of_reach.end(), i)) continue;
    const SeenGaussian g = s.seen(i);
    const double trace = g.covariance[0] + g.covariance[3] + g.covariance[5];
    const double room = bounds.position * std::max({std::sqrt(trace), bounds.min_size, g.min_size});
    for (size_t k = 0; k < 3; ++k) {
      low[k] = std::min(low[k], g.position[k] - room);
      high[k] = std::max(high[k], g.position[k] + room);
    }
  }
  plan->step = static_cast<double>(
      static_cast<float>(std::clamp(plan->step, 0x1p-40, 0x1p60)));  // as the header has it
  const double most = static_cast<double>((1u << kMaxPositionBits) - 2);
  double codes = 1;
  for (size_t k = 0; k < 3; ++k) {
    if (low[k] > high[k]) low[k] = high[k] = 0;  // nothing but escapes
    if (high[k] - low[k] > most * plan->step) {
      const double unused = (1 - kReachUsed) / 2 * most * plan->step;
      low[k] = window_begin(axes[k], kReachUsed * most * plan->step) - unused;
      high[k] = low[k] + most * plan->step;
    }
    plan->center[k] = sound_constant(static_cast<float>(low[k]));
    codes = std::max(codes, (high[k] - static_cast<double>(plan->center[k])) / plan->step);
  }
  plan->bits = 1;
  while (plan->bits < kMaxPositionBits && codes > static_cast<double>((1u << plan->bits) - 1)) {
    ++plan->bits;
  }
}

}  // namespace

ErrorBounds declared_bounds(const EncoderScene& scene, const EncoderSettings& settings) {
  ErrorBounds b;
  if (settings.get_bool(Parameter::kLossless)) return b;
  b.position = settings.get(Parameter::kMaxPositionError);
  b.covariance = settings.get(Parameter::kMaxCovarianceFactor);
  b.opacity = settings.get(Parameter::kMaxOpacityError);
  b.visible = settings.get(Parameter::kMaxVisibleError);
  b.base_color = settings.color_bound(Parameter::kMaxBaseColorError);
  b.directional_color = settings.color_bound(Parameter::kMaxDirectionalColorError);
  b.min_size = scene.extent / kSizesPerExtent;
  return b;
}

PositionPlan plan_positions(const EncoderScene& scene, const EncoderSettings& settings,
                            const Quality& quality, ErrorBounds* bounds) {
  PositionPlan plan;
  plan.opacity_bits = quality.opacity_bits();
  const auto half_step = [](unsigned bits) { return 0.5 / ((1u << bits) - 1); };
  if (settings.get_int(Parameter::kOpacityBits) == 0) {
    while (bounds->opacity > 0 && plan.opacity_bits < kMaxOpacityBits &&
           half_step(plan.opacity_bits) > kOpacityRounding * bounds->opacity) {
      ++plan.opacity_bits;
    }
  }
  bounds->opacity_slack = half_step(plan.opacity_bits);
  if (!settings.codes_fixed_positions()) return plan;
  double importance = 0;
  for (const float w : scene.position_importance) importance += static_cast<double>(w);
  const double wanted = quality.position_step(importance);
  // The step whose rounding, half a diagonal, takes the share that it may of each bound.
  double coarsest = HUGE_VAL;
  const bool early = bounds->position > 0;
  const auto allow = [&](double error) {
    const double share = early ? kPositionRounding : kLateRounding;
    if (error > 0) coarsest = std::min(coarsest, share * error * 2 / std::sqrt(3.0));
  };
  if (early) allow(bounds->position * smallest_size(scene, bounds->min_size));
  allow(bounds->visible);
  plan.step = std::min(wanted, coarsest);

  std::vector<double> axes[3];
  for (size_t k = 0; k < 3; ++k) axes[k] = scene.sorted_axis(k);
  const double reach = kReachUsed * static_cast<double>((1u << kMaxPositionBits) - 2);
  // Without a bound, what a bound of half a size would ask for is fine enough.
  const double enough =
      std::min(coarsest, 0.5 * kLateRounding * bounds->min_size * 2 / std::sqrt(3.0));
  plan.out_of_reach = outside(scene, axes, reach * plan.step);
  const double most = kMaxOutOfReach * static_cast<double>(scene.count);
  while (static_cast<double>(plan.out_of_reach.size()) > most && plan.step < enough) {
    plan.step = std::min(2 * plan.step, enough);
    plan.out_of_reach = outside(scene, axes, reach * plan.step);
  }
  if (early) {
    choose_lattice(scene, axes, *bounds, &plan);
  } else {
    bounds->position_slack = plan.step * std::sqrt(3.0) / 2;
  }
  return plan;
}

}  // namespace l4d
