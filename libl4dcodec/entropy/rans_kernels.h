// SPDX-License-Identifier: Apache-2.0
// Contract of the loops that decode the channels of a rANS block (spec: "rANS blocks").
// Exactness class A: every implementation gives the same integers, the same states and the same
// position for every input.
#pragma once

#include <cstddef>
#include <cstdint>

namespace l4d {

constexpr size_t kRansLanes = 32;
constexpr unsigned kRansScaleBits = 10;
constexpr uint32_t kRansSlots = uint32_t{1} << kRansScaleBits;  // frequencies sum to this
constexpr uint32_t kRansLow = uint32_t{1} << 16;                // states are never below this
constexpr unsigned kRansHybridTokens = 112;
constexpr unsigned kRansWideTokens = 126;

// The decoder between two channels. Symbol i of a channel belongs to lane i mod 32; the lanes share
// all words.
struct RansLanes {
  uint32_t x[kRansLanes];     // each at least kRansLow
  const unsigned char* next;  // 16-bit little-endian words
  const unsigned char* end;
  bool failed;  // a word was needed past the end; it counted as 0
};

// A channel of hybrid integers that a page takes from its lanes.
struct RansHybridTask {
  RansLanes* lanes;
  const uint8_t* contexts;
  size_t count;
  uint16_t* dst;
};

// tables: for each context kRansSlots entries (pack_rans_entry), indexed by the low bits of a
// state. contexts [n]: which table a symbol uses; null = table 0 for all.
struct RansKernels {
  // Integers below 2^16. All tokens of the tables are below kRansHybridTokens.
  void (*hybrid)(RansLanes& lanes, const uint32_t* tables, const uint8_t* contexts, size_t n,
                 uint16_t* dst);
  // Integers below 2^63. All tokens of the tables are below kRansWideTokens.
  void (*wide)(RansLanes& lanes, const uint32_t* tables, const uint8_t* contexts, size_t n,
               uint64_t* dst);
  // hybrid() for two pages at once: both have contexts, or neither, if they have symbols. Null
  // where one page keeps a processor busy.
  void (*hybrid_pair)(const uint32_t* tables, const RansHybridTask& first,
                      const RansHybridTask& second);
};

// The token that a slot stands for, its frequency (1..4096), and the place of the slot among those
// of the token.
constexpr uint32_t pack_rans_entry(uint32_t frequency, uint32_t bias, uint32_t token) {
  return (frequency - 1) << 20 | bias << 8 | token;
}

// Scalar loops in the words of the specification.
const RansKernels& rans_kernels_reference();
// The widest SIMD target of this machine.
const RansKernels& rans_kernels_simd();

}  // namespace l4d
