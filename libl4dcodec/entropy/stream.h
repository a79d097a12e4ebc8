// SPDX-License-Identifier: Apache-2.0
// A stream: n integers of a known width, the unit that every chunk is made of (spec: "Streams").
#pragma once

#include <cstdint>

#include "libl4dcodec/base/bytes.h"
#include "libl4dcodec/base/status.h"
#include "libl4dcodec/entropy/stream_kernels.h"
#include "libl4dcodec/entropy/zstd_codec.h"

namespace l4d {

enum class StreamLayout : uint8_t { kPacked = 0, kPlanes = 1, kConstant = 2 };
constexpr uint8_t kStreamLayoutMask = 0x03;
constexpr uint8_t kStreamDeltaBit = 0x04;

// kRans32 is for pages alone: it is the form of the whole page (container/rans_page.cc).
enum class ChunkCodec : uint8_t { kStored = 0, kZstd = 1, kRans32 = 2 };

// What a stream decoder works with; one per thread.
struct StreamDecoder {
  const StreamKernels* kernels = nullptr;
  ZstdDecompressor zstd;
  Bytes planes;  // scratch
};

// Number of bits that hold every value below `limit` (0 for limit 1).
unsigned bit_width(uint32_t limit);

// Reads one stream of n values of `width` bits, all below `limit` (0 = 2^width), from `in`, whose
// first byte lies at file offset `base` (for messages). n = 0 or width = 0 reads nothing and yields
// zeros.
Status decode_stream(StreamDecoder& decoder, ByteReader& in, uint64_t base, size_t n,
                     unsigned width, uint32_t limit, const char* limit_clause, uint16_t* dst);
// The same for 32-bit values.
Status decode_stream32(StreamDecoder& decoder, ByteReader& in, uint64_t base, size_t n,
                       uint32_t* dst);

// Steps over one stream without decoding it.
Status skip_stream(ByteReader& in, uint64_t base, size_t n, unsigned width);

// Size-driven choice of layout and of plane codecs.
class StreamEncoder {
 public:
  explicit StreamEncoder(int zstd_level) : zstd_(zstd_level) {}
  // Appends the smallest form to out, with a preference for what decodes fast: planes that zstd
  // hardly shortens stay stored, and packed wins against planes unless these save 2 %.
  void encode(const uint16_t* values, size_t n, unsigned width, bool try_delta, Bytes& out);
  void encode32(const uint32_t* values, size_t n, bool try_delta, Bytes& out);

 private:
  template <typename T>
  Bytes encode_form(const T* values, size_t n, unsigned width, bool delta);
  template <typename T>
  void encode_any(const T* values, size_t n, unsigned width, bool try_delta, Bytes& out);
  ZstdCompressor zstd_;
};

// Whole-chunk codec: undoes `codec` into exactly raw_bytes, which may be at most max_raw_bytes. For
// kStored the result aliases `stored`.
Status decode_chunk(StreamDecoder& decoder, uint32_t codec, ByteSpan stored, uint64_t raw_bytes,
                    uint64_t max_raw_bytes, uint64_t offset, Bytes& storage, ByteSpan* out);

}  // namespace l4d
