// SPDX-License-Identifier: Apache-2.0
// The streamable layout (spec: section 12.1): what players need first comes first in the file. The
// places below ascend from the first byte to the last.
#pragma once

#include <cstdint>

#include "libl4dcodec/container/scene_header.h"
#include "libl4dcodec/scene/layers.h"

namespace l4d {

// When a bucket begins: 0 in level 0, which is needed before all others, else 1 + its first phase.
inline uint64_t begin_of_bucket(unsigned level, uint32_t bucket) {
  return level == 0 ? 0 : 1 + (uint64_t{bucket} << (kPhaseBits - bucket_bits(level)));
}

constexpr int kStreamableSectionShift = 60;
constexpr uint64_t kTablesPlace = uint64_t{1} << kStreamableSectionShift;  // codebooks, entropy ..
constexpr uint64_t kPageTablesPlace = uint64_t{2} << kStreamableSectionShift;

// Of directory page d of a layer, whose first bucket counts.
inline uint64_t directory_place(const LayerHeader& layer, uint32_t d) {
  return (uint64_t{3} << kStreamableSectionShift) |
         begin_of_bucket(layer.level, d << layer.directory_bits);
}

// Of the pages and block codebooks of a bucket.
inline uint64_t payload_place(const LayerHeader& layer, uint32_t bucket) {
  return (uint64_t{4} << kStreamableSectionShift) | (begin_of_bucket(layer.level, bucket) << 8) |
         layer.tier;
}

}  // namespace l4d
