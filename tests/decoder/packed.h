// SPDX-License-Identifier: Apache-2.0
// Packed decoding through the public API, and its expansion to floats written from the
// specification.
#pragma once

#include <array>
#include <vector>

#include "l4d/l4d.hpp"

namespace l4d::test {

struct PackedArrays {
  std::vector<uint16_t> position, mean_t, opacity, scale_factor;
  std::array<std::vector<uint8_t>, L4D_COMPONENT_COUNT> depth;
  std::array<std::vector<uint16_t>, L4D_COMPONENT_COUNT> index;   // [L4D_MAX_STAGES, n]
  std::array<std::vector<uint16_t>, L4D_COMPONENT_COUNT> escape;  // [num_escapes, dim]
  std::array<uint64_t, L4D_COMPONENT_COUNT> num_escapes{};
  std::vector<l4d_bucket_span> spans;
  size_t count() const { return mean_t.size(); }
};

// Throws l4d::Error.
PackedArrays decode_packed(const DecoderHandle& decoder, const l4d_query& query);

// What a player does with packed data. ranges, mean_t and all else as in the expanded form, but
// log_scale[3] of permanent layers is 0: the packed form has none.
GaussianArrays expand(const DecoderHandle& decoder, const PackedArrays& packed);

}  // namespace l4d::test
