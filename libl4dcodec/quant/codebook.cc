// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/quant/codebook.h"

#include <cmath>

#include "libl4dcodec/base/half.h"
#include "libl4dcodec/base/ordered.h"
#include "libl4dcodec/container/page.h"

namespace l4d {
namespace {

void allocate(uint32_t num_entries, uint32_t dim, CodebookData* out) {
  out->num_entries = num_entries;
  out->dim = dim;
  out->entries.assign(size_t{num_entries} * dim + CodebookData::kPadding, 0.0f);
}

Status check_consumed(const ByteReader& in, uint64_t base) {
  if (in.remaining() == 0) return {};
  return corrupt("CHNK-7", base + in.position(),
                 std::to_string(in.remaining()) + " bytes left over at the end of a chunk");
}

}  // namespace

Status decode_codebook(StreamDecoder& decoder, ByteSpan raw, uint64_t base,
                       const StageCoding& stage, uint32_t dim, CodebookData* out) {
  allocate(stage.num_entries, dim, out);
  ByteReader in(raw);
  const size_t n = stage.num_entries;
  std::vector<uint16_t> column(n);
  for (uint32_t d = 0; d < dim; ++d) {
    L4D_RETURN_IF_ERROR(decode_stream(decoder, in, base, n, 16, 0, "", column.data()));
    if (stage.element == ElementType::kSq) {
      for (size_t i = 0; i < n; ++i) {
        out->entries[i * dim + d] = stage.step * static_cast<float>(unzigzag16(column[i]));
      }
      continue;
    }
    if (decoder.kernels->unorder_halves(column.data(), n) >= 0x7c00u) {
      return corrupt("CODE-4", base, "codebook value is not finite");
    }
    for (size_t i = 0; i < n; ++i) out->entries[i * dim + d] = half_to_float(column[i]);
  }
  return check_consumed(in, base);
}

Bytes encode_codebook(StreamEncoder& encoder, const StageCoding& stage, const float* values,
                      uint32_t dim) {
  Bytes out;
  std::vector<uint16_t> column(stage.num_entries);
  for (uint32_t d = 0; d < dim; ++d) {
    for (uint32_t i = 0; i < stage.num_entries; ++i) {
      const float v = values[size_t{i} * dim + d];
      column[i] = stage.element == ElementType::kSq
                      ? zigzag16(static_cast<int16_t>(std::lround(v / stage.step)))
                      : order_half(float_to_half(v));
    }
    encoder.encode(column.data(), column.size(), 16, false, out);
  }
  return out;
}

Bytes encode_rcq_table(StreamEncoder& encoder, const std::vector<RcqPair>& pairs,
                       uint32_t num_global, uint32_t num_residual) {
  std::vector<uint16_t> column(pairs.size());
  Bytes out;
  for (size_t i = 0; i < pairs.size(); ++i) column[i] = pairs[i].global;
  encoder.encode(column.data(), column.size(), bit_width(num_global), false, out);
  for (size_t i = 0; i < pairs.size(); ++i) column[i] = pairs[i].residual;
  encoder.encode(column.data(), column.size(), bit_width(num_residual), false, out);
  return out;
}

Status decode_rcq_table(StreamDecoder& decoder, ByteSpan raw, uint64_t base, uint32_t num_entries,
                        const CodebookData& global, const CodebookData& residual,
                        CodebookData* out) {
  ByteReader in(raw);
  std::vector<uint16_t> g(num_entries), r(num_entries);
  L4D_RETURN_IF_ERROR(decode_stream(decoder, in, base, num_entries, bit_width(global.num_entries),
                                    global.num_entries, "RCQ-1", g.data()));
  L4D_RETURN_IF_ERROR(decode_stream(decoder, in, base, num_entries, bit_width(residual.num_entries),
                                    residual.num_entries, "RCQ-1", r.data()));
  L4D_RETURN_IF_ERROR(check_consumed(in, base));
  allocate(num_entries, global.dim, out);
  for (size_t i = 0; i < num_entries; ++i) {
    const float* a = global.row(g[i]);
    const float* b = residual.row(r[i]);
    for (size_t d = 0; d < global.dim; ++d) out->entries[i * global.dim + d] = a[d] + b[d];
  }
  return {};
}

}  // namespace l4d
