// SPDX-License-Identifier: Apache-2.0
#include "encoder/layering.h"

#include <algorithm>
#include <cmath>

#include "libl4dcodec/math/layers.h"

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

}  // namespace

std::vector<LayerPlan> plan_layers(const EncoderScene& s, const EncoderSettings& settings) {
  const uint32_t levels = num_layers(s.timeline.num_frames);
  std::vector<LayerPlan> layers(levels);
  LayerPlan permanent;
  permanent.permanent = true;
  const bool lossless = settings.get_bool(L4D_ENC_LOSSLESS);
  for (uint32_t i = 0; i < s.count; ++i) {
    if (!lossless && is_permanent(s, i)) {
      permanent.members.push_back(i);
    } else {
      const double tau = 8 * s.sigma_t(i) * kExtentGuard;
      layers[layer_of_extent(tau, s.duration, levels)].members.push_back(i);
    }
  }
  for (uint32_t l = 0; l < levels; ++l) layers[l].level = l;
  const double least = std::max(settings.get(L4D_ENC_MERGE_FRACTION) * static_cast<double>(s.count),
                                settings.get(L4D_ENC_MERGE_COUNT));
  const auto merge = [](LayerPlan& from, LayerPlan& to) {
    std::vector<uint32_t> all(from.members.size() + to.members.size());
    std::merge(from.members.begin(), from.members.end(), to.members.begin(), to.members.end(),
               all.begin());
    to.members = std::move(all);
    from.members.clear();
  };
  // Only towards coarser levels: that keeps the bound on neighbours.
  for (uint32_t l = levels - 1; l > 0 && static_cast<double>(layers[l].members.size()) < least;
       --l) {
    merge(layers[l], layers[l - 1]);
  }
  // Two kinds of layer cost two sets of codebooks.
  if (static_cast<double>(permanent.members.size()) < least && permanent.members.size() < s.count) {
    merge(permanent, layers[0]);
  }
  std::vector<LayerPlan> used;
  if (!permanent.members.empty()) used.push_back(std::move(permanent));
  for (LayerPlan& l : layers) {
    if (l.level == 0 || !l.members.empty()) used.push_back(std::move(l));
  }
  return used;
}

}  // namespace l4d
