// SPDX-License-Identifier: Apache-2.0
#include "decoder/playback/rungs.h"

#include <algorithm>

namespace l4d::playback {

Ladder::Ladder(const SceneHeader& header) {
  for (const LayerHeader& layer : header.layers) {
    if (layer.num_gaussians == 0) continue;
    tiers.push_back(layer.tier);
    has_detail = has_detail || (layer.has_entropy && header.has_sh_detail());
  }
  if (tiers.empty()) tiers.push_back(0);
  std::sort(tiers.begin(), tiers.end());
  tiers.erase(std::unique(tiers.begin(), tiers.end()), tiers.end());
}

uint32_t Ladder::rung_of_tier(uint32_t tier) const {
  const auto it = std::lower_bound(tiers.begin(), tiers.end(), tier);
  const size_t rung = static_cast<size_t>(it - tiers.begin());
  return static_cast<uint32_t>(std::min(rung, tiers.size() - 1));
}

uint32_t Ladder::highest_within(const l4d_operating_point& point) const {
  const uint32_t last = static_cast<uint32_t>(tiers.size()) - 1;
  if (point.tiers != 0 && point.tiers <= tiers[last]) {
    // In full detail only with all tiers: below, detail would keep tiers from coming.
    uint32_t rung = last;
    while (rung > 0 && tiers[rung] >= point.tiers) --rung;
    return rung;
  }
  return has_detail && point.detail == L4D_DETAIL_FULL ? last + 1 : last;
}

uint32_t Ladder::detail_of(uint32_t rung) const {
  return has_detail && rung < tiers.size() ? L4D_DETAIL_BASE_COLOR : L4D_DETAIL_FULL;
}

l4d_operating_point Ladder::point_of(uint32_t rung, uint32_t levels) const {
  const uint32_t tiers_shown = rung + 1 < tiers.size() ? tiers[rung] + 1 : 0;
  return {levels, tiers_shown, detail_of(rung), 0};
}

}  // namespace l4d::playback
