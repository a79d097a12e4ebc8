// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "libl4dcodec/base/bytes.h"
#include "libl4dcodec/base/span.h"

struct ZSTD_CCtx_s;
struct ZSTD_DCtx_s;

namespace l4d {

// A reusable compression context; one per thread. Frames carry their content size and no checksum
// (every chunk has its own).
class ZstdCompressor {
 public:
  explicit ZstdCompressor(int level);
  ~ZstdCompressor();
  ZstdCompressor(const ZstdCompressor&) = delete;
  ZstdCompressor& operator=(const ZstdCompressor&) = delete;
  // Throws std::bad_alloc; no other failure is possible with a buffer of the bound's size.
  Bytes compress(ByteSpan source);

 private:
  ZSTD_CCtx_s* context_;
};

// What a decoder that works in pieces has to keep at most (spec: CHNK-5).
constexpr uint64_t kMaxZstdWindow = uint64_t{1} << 26;

// A reusable decompression context; one per thread.
class ZstdDecompressor {
 public:
  ZstdDecompressor();
  ~ZstdDecompressor();
  ZstdDecompressor(const ZstdDecompressor&) = delete;
  ZstdDecompressor& operator=(const ZstdDecompressor&) = delete;
  // True if `frame` is exactly one zstd frame of a window within kMaxZstdWindow that decodes to
  // exactly `size` bytes, and whose own checksum, if it has one, is right.
  bool decompress(ByteSpan frame, unsigned char* dst, size_t size);

 private:
  ZSTD_DCtx_s* context_;
};

}  // namespace l4d
