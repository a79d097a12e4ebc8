// SPDX-License-Identifier: Apache-2.0
#include "encoder/plan/layers.h"

#include <algorithm>
#include <cmath>

#include "encoder/plan/mean_times.h"
#include "encoder/plan/tiers.h"
#include "encoder/prepare/quality.h"
#include "libl4dcodec/scene/layers.h"

namespace l4d {
namespace {

// A Gaussian is permanent if over the whole sequence it fades by less than this share and moves by
// less than this share of its own size.
constexpr double kPermanentTolerance = 1e-3;

bool is_permanent(const EncoderScene& s, size_t i) {
  const double begin = s.timeline.time_begin;
  const double reach =
      std::max(std::fabs(begin - s.mean_t[i]), std::fabs(begin + s.duration - s.mean_t[i]));
  if (0.5 * s.lambda[i] * reach * reach > kPermanentTolerance) return false;
  double speed2 = 0;
  double largest = 0;
  for (size_t k = 0; k < 3; ++k) {
    speed2 += s.velocity[3 * i + k] * s.velocity[3 * i + k];
    largest = std::max(largest, std::exp(static_cast<double>(s.log_scale[4 * i + k])));
  }
  return std::sqrt(speed2) * s.duration <= kPermanentTolerance * largest;
}

// Of local times in lossless streams, in temporal scales.
constexpr double kLosslessError = 0.001;

// Mean times this many durations outside the sequence, whose Gaussians live as long.
constexpr double kFar = 64;

void merge(LayerPlan& from, LayerPlan& to) {
  std::vector<uint32_t> all(from.gaussians.size() + to.gaussians.size());
  std::merge(from.gaussians.begin(), from.gaussians.end(), to.gaussians.begin(), to.gaussians.end(),
             all.begin());
  to.gaussians = std::move(all);
  from.gaussians.clear();
}

// Takes what is far from level 0, where codes that reach it are too coarse for short-lived ones.
LayerPlan take_far(const EncoderScene& s, double error, LayerPlan* level0) {
  const double center = bucket_center(s.timeline, 0, 0);
  LayerPlan far;
  far.far = true;
  double reach = 0, tolerance = HUGE_VAL;
  for (const uint32_t i : level0->gaussians) {
    reach = std::max(reach, std::fabs(s.mean_t[i] - center));
    tolerance = std::min(tolerance, error * s.sigma_t(i));
  }
  if (fixed_mean_times_fit(reach, tolerance)) return far;
  std::vector<uint32_t> near;
  for (const uint32_t i : level0->gaussians) {
    const bool is_far = std::fabs(s.mean_t[i] - center) > kFar * s.duration;
    (is_far ? far.gaussians : near).push_back(i);
  }
  level0->gaussians = std::move(near);
  return far;
}

}  // namespace

std::vector<LayerPlan> plan_layers(const EncoderScene& s, const EncoderSettings& settings) {
  const uint32_t levels = num_layers(s.timeline.num_frames);
  std::vector<LayerPlan> layers(levels);
  LayerPlan permanent;
  permanent.permanent = true;
  const bool lossless = settings.get_bool(Parameter::kLossless);
  std::vector<LayerPlan> flat(levels);
  for (uint32_t i = 0; i < s.count; ++i) {
    if (s.is_flat(i)) {
      const uint32_t level = layer_of_window(s.window[i], s.timeline.num_frames, levels);
      flat[level].gaussians.push_back(i);
    } else if (!lossless && is_permanent(s, i)) {
      permanent.gaussians.push_back(i);
    } else {
      const double tau = 8 * s.sigma_t(i) * kExtentGuard;
      layers[layer_of_extent(tau, s.duration, levels)].gaussians.push_back(i);
    }
  }
  for (uint32_t l = 0; l < levels; ++l) {
    layers[l].level = flat[l].level = l;
    flat[l].flat = true;
  }
  const double least =
      std::max(settings.get(Parameter::kMergeFraction) * static_cast<double>(s.count),
               settings.get(Parameter::kMergeCount));
  // Lossless times are exact; those in binary32 that a decoder slices with are nearly so.
  const double error = lossless ? kLosslessError : Quality(settings, s.count).mean_t_error();
  const bool f16 = !lossless && settings.codes_half_mean_times();
  const auto stays_exact = [&](const LayerPlan& from) {
    const double width = bucket_width(s.timeline, from.level - 1);
    return std::all_of(from.gaussians.begin(), from.gaussians.end(), [&](uint32_t i) {
      return mean_time_fits(f16, width, error * s.sigma_t(i));
    });
  };
  // Only towards coarser levels: that keeps the bound on neighbours.
  for (uint32_t l = levels - 1; l > 0 && static_cast<double>(layers[l].gaussians.size()) < least;
       --l) {
    if (stays_exact(layers[l])) merge(layers[l], layers[l - 1]);
  }
  // Windows are exact in all layers, and what fits a bucket fits the one around it.
  for (uint32_t l = levels - 1; l > 0 && static_cast<double>(flat[l].gaussians.size()) < least;
       --l) {
    merge(flat[l], flat[l - 1]);
  }
  // Two kinds of layer cost two sets of codebooks.
  if (static_cast<double>(permanent.gaussians.size()) < least &&
      permanent.gaussians.size() < s.count) {
    merge(permanent, layers[0]);
  }
  // In level 0 the format has room for four layers, and for two that are stored as they are.
  const LayerPlan far =
      lossless || f16 || levels == 1 ? LayerPlan() : take_far(s, error, &layers[0]);
  std::vector<LayerPlan> used;
  if (!permanent.gaussians.empty()) used.push_back(std::move(permanent));
  if (!far.gaussians.empty()) used.push_back(far);
  for (LayerPlan& l : layers) {
    const unsigned level = l.level;
    if (level == 0 || !l.gaussians.empty()) used.push_back(std::move(l));
    if (!flat[level].gaussians.empty()) used.push_back(std::move(flat[level]));
  }
  if (!settings.tiers().empty()) return cut_into_tiers(s, settings, least, std::move(used));
  return used;
}

}  // namespace l4d
