// SPDX-License-Identifier: Apache-2.0
// Codebook chunks and block codebooks (spec: "Codebooks", "Residual codebook quantisation").
#pragma once

#include <cstdint>
#include <vector>

#include "libl4dcodec/base/status.h"
#include "libl4dcodec/container/scene_header.h"
#include "libl4dcodec/entropy/stream.h"
#include "libl4dcodec/quant/integer_basis.h"

namespace l4d {

// Entries as float32, [num_entries, dim]. `entries` is longer than that by kPadding zeros, so that
// a vector load of the last row stays inside.
struct CodebookData {
  static constexpr size_t kPadding = 16;
  uint32_t num_entries = 0;
  uint32_t dim = 0;
  std::vector<float> entries;
  IntegerBasis integer;  // of bases of SH

  const float* row(size_t i) const { return entries.data() + i * dim; }
  uint64_t memory_bytes() const { return entries.size() * sizeof(float); }
};

Status decode_codebook(StreamDecoder& decoder, ByteSpan raw, uint64_t base,
                       const StageCoding& stage, uint32_t dim, CodebookData* out);
// values: [stage.num_entries, dim], each exactly what its element type can hold.
Bytes encode_codebook(StreamEncoder& encoder, const StageCoding& stage, const float* values,
                      uint32_t dim);

// A block codebook is sent as pairs (entry of the layer's codebook, entry of the residual
// codebook).
struct RcqPair {
  uint16_t global = 0;
  uint16_t residual = 0;
};
Bytes encode_rcq_table(StreamEncoder& encoder, const std::vector<RcqPair>& pairs,
                       uint32_t num_global, uint32_t num_residual);
Status decode_rcq_table(StreamDecoder& decoder, ByteSpan raw, uint64_t base, uint32_t num_entries,
                        const CodebookData& global, const CodebookData& residual,
                        CodebookData* out);

}  // namespace l4d
