// SPDX-License-Identifier: Apache-2.0
// What a rans32 page is made of, and the tables that its channels are coded with (spec: "rANS
// pages").
#pragma once

#include <cstdint>
#include <vector>

#include "libl4dcodec/base/status.h"
#include "libl4dcodec/container/scene_header.h"
#include "libl4dcodec/entropy/rans.h"

namespace l4d {

enum class ChannelKind : uint8_t {
  kPosition,  // gaps of the Morton codes, wide integers; all others are hybrid ones
  kMeanT,
  kMeanTFine,  // fixed mean times, where the layer refines them
  kWindow,     // flat windows: one per column that has bits
  kOpacity,
  kScaleFactor,
  kDepth,         // vq
  kIndex,         // vq, one per stage
  kEscape,        // vq, one per number
  kStepExponent,  // transform
  kEobIndex,      // transform, where the EOB table has more than one step
  kCoefficient,   // transform, one per coefficient
};

struct ChannelSpec {
  ChannelKind kind;
  uint8_t component;  // L4D_COMPONENT_*, of the kinds from kDepth on
  uint8_t index;      // stage, number, coefficient or column
  uint8_t contexts;   // how many tables its symbols may tell apart
};

// A coefficient's context is its Gaussian's step exponent and how large the two coefficients before
// it are.
constexpr unsigned kMagnitudes = 5;
inline unsigned magnitude_context(unsigned sum) {  // of the two magnitudes
  return unsigned{sum > 0} + unsigned{sum > 2} + unsigned{sum > 6} + unsigned{sum > 14};
}

constexpr unsigned kMaxEntropyTables = 128;

// Every channel that pages of a layer may have, in the order in which pages hold them. Those of SH
// are the last.
std::vector<ChannelSpec> page_channels(const SceneHeader& header, const LayerHeader& layer);

// Index of the first channel of SH detail, which is the SH chunk of pages that have two: the first
// coefficient of SH beyond the base, or the first channel of SH where there is no base. The number
// of channels where there is none.
size_t first_detail_channel(const SceneHeader& header, const std::vector<ChannelSpec>& channels);

// The most symbols of a Gaussian in the rANS pages of a layer, as its header declares it or as many
// as there are channels; 0 where it has no such pages.
uint64_t most_symbols(const SceneHeader& header, const LayerHeader& layer);

// Whether rans32 pages can hold a layer's codings: they cannot hold raw float32 columns.
bool rans_codable(const SceneHeader& header, const LayerHeader& layer);

// The tables of a layer.
struct EntropyTables {
  std::vector<ChannelSpec> channels;
  std::vector<uint32_t> entries;           // [tables, kRansSlots], as kernels take them
  std::vector<std::vector<uint8_t>> maps;  // per channel [contexts]: which table

  uint64_t memory_bytes() const;
};

// Upper bound of raw_bytes (spec: CHNK-8).
uint64_t max_entropy_bytes(const std::vector<ChannelSpec>& channels);
// What the parsed form of `raw` takes.
uint64_t entropy_memory(ByteSpan raw, const std::vector<ChannelSpec>& channels);

Status parse_entropy_tables(ByteSpan raw, uint64_t base, const SceneHeader& header,
                            const LayerHeader& layer, EntropyTables* out);

}  // namespace l4d
