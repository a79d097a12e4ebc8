// SPDX-License-Identifier: Apache-2.0
// What verbs with --detail share.
#pragma once

#include <string>

#include "cli/command/context.h"
#include "l4d/decode.h"

namespace l4d::cli {

inline void add_detail_option(Verb* verb, std::string& detail) {
  verb->add_option("--detail", detail,
                   "full, or base: of a stream, base colours without the SH detail of its large "
                   "pages, which is not read then")
      ->type_name("NAME")
      ->one_of({"full", "base"})
      ->capture_default_str();
}

inline uint32_t detail_id(const std::string& detail) {
  return detail == "base" ? L4D_DETAIL_BASE_COLOR : L4D_DETAIL_FULL;
}

// max_level, max_tier: UINT32_MAX = all.
inline l4d_operating_point operating_point(uint32_t max_level, uint32_t max_tier,
                                           const std::string& detail) {
  return {max_level + 1, max_tier + 1, detail_id(detail), 0};
}

// Every verb that can leave out tiers calls it alike.
inline void add_tier_option(Verb* verb, uint32_t& max_tier) {
  verb->add_option("--max-tier", max_tier,
                   "Leave out tiers above this: a preview without the less important of the "
                   "long-lived Gaussians (encode --tiers)")
      ->type_name("N")
      ->whole_number(0, 255);
}

}  // namespace l4d::cli
