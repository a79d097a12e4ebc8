// SPDX-License-Identifier: Apache-2.0
// Names of a compressed 3DGS PLY: chunks of 256 Gaussians, whose numbers are fractions of the
// ranges of their chunk.
#pragma once

#include <cstddef>
#include <cstdint>

namespace l4d::io {

constexpr uint64_t kPlyChunk = 256;
// Ranges of a chunk: least x y z, largest x y z of positions, of scales, and of colours.
constexpr size_t kPositionRange = 0, kScaleRange = 6, kColorRange = 12, kRanges = 18;
constexpr const char* kRangeNames[kRanges] = {
    "min_x",       "min_y",       "min_z",       "max_x",       "max_y",       "max_z",
    "min_scale_x", "min_scale_y", "min_scale_z", "max_scale_x", "max_scale_y", "max_scale_z",
    "min_r",       "min_g",       "min_b",       "max_r",       "max_g",       "max_b"};
constexpr const char* kPackedNames[4] = {"packed_position", "packed_rotation", "packed_scale",
                                         "packed_color"};

}  // namespace l4d::io
