// SPDX-License-Identifier: Apache-2.0
// The content of one chunk, given straight to its parser: a codebook, a block codebook, a page, one
// stream, or a chunk under a codec. Both sets of loops must agree on every input.
#include <algorithm>
#include <cstdlib>
#include <cstring>

#include "libl4dcodec/container/page.h"
#include "libl4dcodec/entropy/stream.h"
#include "libl4dcodec/quant/codebook.h"

namespace {

using namespace l4d;

// Kind, number of things (two bytes), and two bytes of choices.
constexpr size_t kControlBytes = 5;

const StreamKernels& kernels(bool reference) {
  return reference ? stream_kernels_reference() : stream_kernels_simd();
}

// What a parser made of the input: the status, and the numbers.
struct Result {
  l4d_status status = L4D_OK;
  std::vector<float> values;
  std::vector<uint16_t> codes;

  bool operator==(const Result& other) const {
    return status == other.status && codes == other.codes && values.size() == other.values.size() &&
           (values.empty() ||
            std::memcmp(values.data(), other.values.data(), values.size() * sizeof(float)) == 0);
  }
};

CodebookData codebook_of(uint32_t entries, uint32_t dim) {
  CodebookData codebook;
  codebook.num_entries = entries;
  codebook.dim = dim;
  codebook.entries.assign(size_t{entries} * dim + CodebookData::kPadding, 0.5f);
  return codebook;
}

Result codebook(StreamDecoder& decoder, ByteSpan raw, uint32_t n, unsigned choice) {
  static constexpr uint32_t kDims[] = {3, 4, 12, 27, 48};
  StageCoding stage;
  stage.num_entries = 1 + n;
  CodebookData codebook;
  Result r;
  r.status = decode_codebook(decoder, raw, 0, stage, kDims[choice % 5], &codebook).code();
  if (r.status == L4D_OK) r.values = codebook.entries;
  return r;
}

Result block_codebook(StreamDecoder& decoder, ByteSpan raw, uint32_t n, unsigned choice) {
  const CodebookData global = codebook_of(1 + (choice & 15) * 17, 4);
  const CodebookData residual = codebook_of(1 + (choice >> 4) * 3, 4);
  CodebookData codebook;
  Result r;
  r.status = decode_rcq_table(decoder, raw, 0, 1 + n, global, residual, &codebook).code();
  if (r.status == L4D_OK) r.values = codebook.entries;
  return r;
}

Result stream(StreamDecoder& decoder, ByteSpan raw, uint32_t n, unsigned choice) {
  Result r;
  ByteReader in(raw), skipped(raw);
  const unsigned width = choice % 33;
  l4d_status skip = L4D_OK;
  if (width > 16) {
    std::vector<uint32_t> values(n);
    r.status = decode_stream32(decoder, in, 0, n, values.data()).code();
    skip = skip_stream(skipped, 0, n, 32).code();
    for (const uint32_t v : values) {
      r.codes.push_back(static_cast<uint16_t>(v));
      r.codes.push_back(static_cast<uint16_t>(v >> 16));
    }
  } else {
    r.codes.resize(n);
    r.status = decode_stream(decoder, in, 0, n, width, 0, "", r.codes.data()).code();
    skip = skip_stream(skipped, 0, n, width).code();
  }
  if (r.status == L4D_OK) {
    // Stepping over a stream ends where reading it ends.
    if (skip != L4D_OK || skipped.position() != in.position()) std::abort();
  } else {
    r.codes.clear();
  }
  return r;
}

SceneHeader page_header(unsigned a, unsigned b) {
  SceneHeader header;
  header.sh_degree = a & 3;
  header.position = (a & 4) != 0 ? CoordinateCodingId::kRaw32 : CoordinateCodingId::kF16;
  header.opacity.coding = static_cast<ScalarCodingId>((a >> 3) % 3);
  header.opacity.bits = 1 + (a >> 5);
  header.layers.resize(1);
  LayerHeader& layer = header.layers[0];
  layer.permanent = (b & 1) != 0;
  layer.mean_t = layer.permanent ? CoordinateCodingId::kNone
                 : (b & 2) != 0  ? CoordinateCodingId::kRaw32
                                 : CoordinateCodingId::kF16;
  layer.scale_factor.coding = (b & 4) != 0 ? ScalarCodingId::kSq : ScalarCodingId::kConstant;
  layer.scale_factor.bits = 12;
  const auto set = [&](ComponentCoding& c, unsigned kind) {
    c.coding = static_cast<ComponentCodingId>(kind % 3);
    if (!c.vq()) return;
    c.stages.resize(1 + (b >> 6));
    uint32_t entries = 1 + b;
    for (StageCoding& s : c.stages) s.num_entries = entries = 1 + entries / 2;
    c.escapes = (b & 8) != 0;
  };
  set(header.sh, 2 + (b >> 4));
  for (ComponentCoding& c : layer.component) set(c, 2 + (b >> 5));
  return header;
}

Result page(StreamDecoder& decoder, ByteSpan raw, uint32_t n, unsigned a, unsigned b,
            PageColumns* columns) {
  const SceneHeader header = page_header(a, b);
  Result r;
  SectionBytes sections{};
  r.status =
      decode_page(decoder, raw, 0, header, header.layers[0], nullptr, 1 + n, {}, columns, &sections)
          .code();
  if (r.status != L4D_OK) return r;
  uint64_t sum = 0;
  for (const uint64_t s : sections) sum += s;
  if (sum != raw.size()) std::abort();
  // What is stepped over has the same place and size.
  PageColumns none;
  SectionBytes stepped{};
  if (!decode_page(decoder, raw, 0, header, header.layers[0], nullptr, 1 + n,
                   {false, false, false, false, false, false, false}, &none, &stepped)
           .ok() ||
      stepped != sections) {
    std::abort();
  }
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    const ComponentColumns& from = columns->component[c];
    for (size_t s = 0; s < L4D_MAX_STAGES; ++s) {
      const uint16_t* index = from.index[s].data();
      r.codes.insert(r.codes.end(), index, index + from.index_count[s]);
      const ComponentCoding& coding = header.component(header.layers[0], c);
      for (size_t i = 0; i < from.index_count[s]; ++i) {
        if (index[i] >= coding.stages[s].num_entries) std::abort();
      }
    }
  }
  return r;
}

Result chunk(StreamDecoder& decoder, ByteSpan raw, uint32_t n, unsigned choice) {
  Bytes storage;
  ByteSpan out;
  Result r;
  r.status = decode_chunk(decoder, choice % 3, raw, n, 1u << 15, 0, storage, &out).code();
  if (r.status != L4D_OK) return r;
  if (out.size() != n || n > 1u << 15) std::abort();
  r.codes.assign(out.begin(), out.end());
  return r;
}

Result run(StreamDecoder& decoder, PageColumns* columns, const uint8_t* control, ByteSpan raw) {
  const uint32_t n = control[1] | uint32_t{control[2]} << 8;
  switch (control[0] % 5) {
    case 0:
      return codebook(decoder, raw, n % 4096, control[3]);
    case 1:
      return block_codebook(decoder, raw, n % 4096, control[3]);
    case 2:
      return page(decoder, raw, n % 4096, control[3], control[4], columns);
    case 3:
      return stream(decoder, raw, n, control[3]);
    default:
      return chunk(decoder, raw, n, control[3]);
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  if (size < kControlBytes) return 0;
  const Bytes raw(data + kControlBytes, data + size);
  Result results[2];
  for (const bool reference : {false, true}) {
    StreamDecoder decoder;
    decoder.kernels = &kernels(reference);
    PageColumns columns;
    results[reference] = run(decoder, &columns, data, raw);
    // The same buffers again: nothing may be left of the round before.
    if (!(run(decoder, &columns, data, raw) == results[reference])) std::abort();
  }
  if (!(results[0] == results[1])) std::abort();
  return 0;
}
