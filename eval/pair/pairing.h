// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "eval/observer.h"
#include "eval/scene/decoded_scene.h"
#include "io/scene/scene.h"

namespace l4d::eval {

constexpr uint32_t kUnmatched = UINT32_MAX;

// Which Gaussian of A each Gaussian of B is. A coded scene has another order and no ids.
struct Pairing {
  // "order": told by the encoder; "exact": all rows of one are equal to rows of the other, bit for
  // bit; "stated": no pair differs by more than B, a stream, states of itself; "unknown": there are
  // no such pairs, or B states nothing, and all that is known are rows of the same bits.
  std::string match;
  std::vector<uint32_t> a_of_b;  // [count of B], kUnmatched where there is none
  uint64_t matched = 0;
  uint64_t equal_rows = 0;  // pairs of the same bits

  bool is_known() const { return match != "unknown"; }
};

// order[i]: index in A of Gaussian i of B. Throws io::Error(L4D_ERR_INVALID_ARGUMENT) where it does
// not fit.
Pairing pair_by_order(const io::Scene& a, const io::Scene& b, const std::vector<uint32_t>& order);

// min_sizes, stream_a: as PairMeter takes them. threads: 0 = one per core; the pairs are the same
// for any number.
Pairing pair_by_content(const io::Scene& a, const DecodedScene& b, uint32_t threads,
                        const std::vector<float>& min_sizes = {},
                        const DecodedScene* stream_a = nullptr, const Observer& observer = {});

// The u32 little-endian array that `encode --order` writes.
std::vector<uint32_t> read_order(const std::string& path);
void write_order(const std::string& path, const std::vector<uint32_t>& order);

}  // namespace l4d::eval
