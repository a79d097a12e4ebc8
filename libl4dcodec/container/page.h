// SPDX-License-Identifier: Apache-2.0
// Pages: up to 65536 Gaussians of one bucket as a sequence of streams (spec: "Pages").
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "l4d/decode.h"
#include "libl4dcodec/base/status.h"
#include "libl4dcodec/container/directory.h"
#include "libl4dcodec/container/scene_header.h"
#include "libl4dcodec/entropy/stream.h"

namespace l4d {

// What a page holds of one component, not yet dequantised.
struct ComponentColumns {
  std::vector<uint8_t> depth;  // [n], kLiteralDepth = literal; empty where all have full depth
  // index[s]: one value for each Gaussian whose depth is above s, in order.
  std::array<std::vector<uint16_t>, L4D_MAX_STAGES> index;
  std::vector<uint16_t> literal;  // [num_literals, dim] binary16
  std::vector<float> raw;         // [n, dim]
  size_t num_literals = 0;
  std::array<size_t, L4D_MAX_STAGES> index_count{};
};

// All columns of a page. Buffers are reused from page to page: sizes only grow, n counts.
struct PageColumns {
  size_t n = 0;
  std::array<std::vector<uint16_t>, 3> position;  // binary16
  std::array<std::vector<float>, 3> raw_position;
  std::vector<uint16_t> mean_t;  // binary16
  std::vector<float> raw_mean_t;
  std::vector<uint16_t> opacity;  // SQ codes
  std::vector<float> raw_opacity;
  std::vector<uint16_t> scale_factor;
  std::vector<float> raw_scale_factor;
  std::array<ComponentColumns, L4D_COMPONENT_COUNT> component;
};

// Which attributes to decode; the streams of others are stepped over.
struct PageWants {
  bool position = true;
  bool mean_t = true;
  bool opacity = true;
  bool scale = true;  // scale factor and normalised scale
  bool rotor = true;
  bool sh = true;
};

// Bytes of a page by section, indexed by L4D_SECTION_*.
using SectionBytes = std::array<uint64_t, L4D_SECTION_COUNT>;

// Number of entries that stage 0 of component c indexes in a page of `block` (may be null).
uint32_t stage0_entries(const SceneHeader& header, const LayerHeader& layer, unsigned c,
                        const BlockRecord* block);

// What n Gaussians can take at most (spec: CHNK-8): every attribute as float32, or all stages of all
// components, whichever is longer.
uint64_t max_page_bytes(const SceneHeader& header, size_t n);

// Parses the raw bytes of a page. `base` is the file offset used in messages; sections may be null.
Status decode_page(StreamDecoder& decoder, ByteSpan raw, uint64_t base, const SceneHeader& header,
                   const LayerHeader& layer, const BlockRecord* block, size_t n,
                   const PageWants& wants, PageColumns* out, SectionBytes* sections);

Bytes encode_page(StreamEncoder& encoder, const SceneHeader& header, const LayerHeader& layer,
                  const BlockRecord* block, const PageColumns& columns);

}  // namespace l4d
