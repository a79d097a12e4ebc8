// SPDX-License-Identifier: Apache-2.0
// The ladder of a stream: its tiers one by one in base colours, then all of it in full detail. Each
// rung contains the one below it.
#pragma once

#include <cstdint>
#include <vector>

#include "l4d/decode.h"
#include "libl4dcodec/container/scene_header.h"

namespace l4d::playback {

struct Ladder {
  std::vector<uint32_t> tiers;  // ascending, of layers that have Gaussians; 1 or more
  bool has_detail = false;      // the last rung has SH chunks, the others have none

  explicit Ladder(const SceneHeader& header);
  Ladder() : tiers(1) {}
  uint32_t size() const { return static_cast<uint32_t>(tiers.size()) + (has_detail ? 1 : 0); }
  // The lowest rung that has a tier.
  uint32_t rung_of_tier(uint32_t tier) const;
  // The highest rung within a point.
  uint32_t highest_within(const l4d_operating_point& point) const;
  uint32_t detail_of(uint32_t rung) const;
  // What a slice shows of a rung. The last tier of all is no limit: 0.
  l4d_operating_point point_of(uint32_t rung, uint32_t levels) const;
};

}  // namespace l4d::playback
