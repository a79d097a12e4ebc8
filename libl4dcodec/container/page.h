// SPDX-License-Identifier: Apache-2.0
// Pages: up to 65536 Gaussians of one bucket as a sequence of streams (spec: "Pages").
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "l4d/decode.h"
#include "l4d/experimental/inspect.h"
#include "libl4dcodec/base/status.h"
#include "libl4dcodec/container/channels.h"
#include "libl4dcodec/container/directory.h"
#include "libl4dcodec/container/scene_header.h"
#include "libl4dcodec/entropy/stream.h"
#include "libl4dcodec/scene/window.h"

namespace l4d {

// Loops that take coefficients from a column may read so many numbers behind the last.
constexpr size_t kCoefficientPadding = 16;

// What a page holds of one component, not yet dequantised.
struct ComponentColumns {
  std::vector<uint8_t> depth;  // [n], kEscapeDepth = escape; empty where all have full depth
  // index[s]: one value for each Gaussian whose depth is above s, in order.
  std::array<std::vector<uint16_t>, L4D_MAX_STAGES> index;
  std::vector<uint16_t> escape;  // [num_escapes, dim] binary16
  std::vector<float> raw;        // [n, dim]
  size_t num_escapes = 0;
  std::array<size_t, L4D_MAX_STAGES> index_count{};
  // Transform: coefficient[k] has one value for each Gaussian whose EOB index reaches k, in order.
  // Where a page is decoded, kCoefficientPadding more lie behind.
  std::vector<uint8_t> step_exponent;  // [n] step exponent
  std::vector<uint8_t> eob_index;      // [n] step of the EOB table, 0 = no coefficients
  std::array<std::vector<int16_t>, kMaxCoefficients> coefficient;
  std::array<size_t, kMaxCoefficients> coefficient_count{};
};

// All columns of a page. Buffers are reused from page to page: sizes only grow, n counts.
struct PageColumns {
  size_t n = 0;
  uint64_t symbols = 0;  // that rANS has coded, of the wanted channels
  // False: SH is what the base chunk of a rans32 page holds, coefficients below the base or
  // nothing.
  bool sh_detail = true;
  std::array<std::vector<uint16_t>, 3> position;  // binary16
  std::array<std::vector<uint32_t>, 3> fixed_position;
  std::array<std::vector<float>, 3> raw_position;
  std::vector<uint16_t> mean_t;       // binary16, or codes of fixed ones
  std::vector<uint16_t> mean_t_fine;  // refinements
  std::vector<float> raw_mean_t;
  std::vector<double> raw64_mean_t;
  std::array<std::vector<uint16_t>, kWindowColumns> window;
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
  bool sh_detail = true;  // where sh: SH chunks too
};

// Bytes of a page by section, indexed by L4D_SECTION_*.
using SectionBytes = std::array<uint64_t, L4D_SECTION_COUNT>;

// Number of entries that stage 0 of component c indexes in a page of `block` (may be null).
uint32_t stage0_entries(const SceneHeader& header, const LayerHeader& layer, unsigned c,
                        const BlockRecord* block);

// The window of Gaussian i of a page of `bucket`, of a flat layer; nothing says that it is valid.
FrameWindow window_of(const LayerHeader& layer, uint32_t bucket, uint32_t num_frames,
                      const PageColumns& columns, size_t i);
// WIND-3: whether all of them lie in the sequence and none is empty.
Status check_windows(const SceneHeader& header, const LayerHeader& layer, uint32_t bucket,
                     uint64_t at, const PageColumns& columns);

// Number of coefficients that each EOB index of an EOB table has.
inline unsigned eob_coefficients(const ComponentCoding& coding, unsigned eob_index) {
  return eob_index == 0 ? 0 : coding.eob_table[eob_index - 1];
}
inline uint16_t zigzag16(int16_t v) {
  return static_cast<uint16_t>((static_cast<uint32_t>(v) << 1) ^ (v < 0 ? 0xffffu : 0u));
}
inline int16_t unzigzag16(uint16_t z) { return static_cast<int16_t>((z >> 1) ^ (0u - (z & 1u))); }

// What n Gaussians can take at most (spec: CHNK-8): every attribute as float32, or all stages of
// all components, whichever is longer.
uint64_t max_page_bytes(const SceneHeader& header, size_t n);

// Parses the raw bytes of a page. `base` is the file offset used in messages; sections may be null.
Status decode_page(StreamDecoder& decoder, ByteSpan raw, uint64_t base, const SceneHeader& header,
                   const LayerHeader& layer, const BlockRecord* block, size_t n,
                   const PageWants& wants, PageColumns* out, SectionBytes* sections);

// A rans32 page in its parts, and where they lie in the file.
struct RansPageChunks {
  ByteSpan first;
  uint64_t first_at = 0;
  bool has_detail = false;  // the page has an SH chunk, be it given or not
  ByteSpan detail;
  uint64_t detail_at = 0;
};

// Working memory of one page at a time.
struct RansDecoder {
  const RansKernels* kernels = nullptr;
  const StreamKernels* streams = nullptr;
  std::vector<uint64_t> wide;
  std::vector<uint16_t> codes;
  std::vector<uint8_t> contexts, tables, step_exponent, eob_index, before,
      last;  // of the Gaussians that a channel is about
};

struct RansPage {
  RansDecoder* decoder = nullptr;
  RansPageChunks parts;
  const BlockRecord* block = nullptr;  // may be null
  size_t n = 0;
  PageColumns* out = nullptr;
  SectionBytes* sections = nullptr;  // where set, all channels are parsed
  // Null where the SH chunk is not wanted or there is none; else it gets what became of that,
  // beside which the columns hold the base chunk as if the second were not wanted.
  Status* detail = nullptr;
  Status status{};  // ok before
};

// Parses a rans32 page with the tables of its layer. Channels are coded one after another, so that
// only those behind the last one that is wanted can be left out, and the SH chunk; columns before
// are filled unasked. What became of it is in its status.
void decode_rans_page(const SceneHeader& header, const LayerHeader& layer,
                      const EntropyTables& tables, const PageWants& wants, RansPage* page);
// Two pages of a layer at once, each as if alone: the states of one do not wait for those of the
// other.
void decode_rans_pages(const SceneHeader& header, const LayerHeader& layer,
                       const EntropyTables& tables, const PageWants& wants, RansPage* first,
                       RansPage* second);

// Walks the channels of a page that rANS can code in their order, with the context of each symbol:
// what counts tokens for tables and what codes with them see the same. Either span of values is
// empty.
struct ChannelSymbols {
  size_t channel = 0;  // index in page_channels()
  Span<const uint16_t> hybrid;
  Span<const uint64_t> wide;
  Span<const uint8_t> contexts;  // empty = context 0 for all
};
class ChannelVisitor {
 public:
  virtual ~ChannelVisitor() = default;
  virtual void visit(const ChannelSymbols& symbols) = 0;
};
void visit_channels(const SceneHeader& header, const LayerHeader& layer,
                    const std::vector<ChannelSpec>& channels, const PageColumns& columns,
                    ChannelVisitor& visitor);

Bytes encode_page(StreamEncoder& encoder, const SceneHeader& header, const LayerHeader& layer,
                  const BlockRecord* block, const PageColumns& columns);

}  // namespace l4d
