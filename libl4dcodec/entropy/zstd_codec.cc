// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/entropy/zstd_codec.h"

#include <zstd.h>

#include <new>

namespace l4d {

ZstdCompressor::ZstdCompressor(int level) : context_(ZSTD_createCCtx()) {
  if (context_ == nullptr) throw std::bad_alloc();
  ZSTD_CCtx_setParameter(context_, ZSTD_c_compressionLevel, level);
}

ZstdCompressor::~ZstdCompressor() { ZSTD_freeCCtx(context_); }

Bytes ZstdCompressor::compress(ByteSpan source) {
  Bytes out(ZSTD_compressBound(source.size()));
  const size_t n = ZSTD_compress2(context_, out.data(), out.size(), source.data(), source.size());
  if (ZSTD_isError(n)) throw std::bad_alloc();
  out.resize(n);
  return out;
}

ZstdDecompressor::ZstdDecompressor() : context_(ZSTD_createDCtx()) {
  if (context_ == nullptr) throw std::bad_alloc();
}

ZstdDecompressor::~ZstdDecompressor() { ZSTD_freeDCtx(context_); }

namespace {

// Window_Size of a frame that has a Window_Descriptor (RFC 8878, 3.1.1.1.2), else 0: the window of
// a frame in a single segment is its content.
uint64_t window_bytes(ByteSpan frame) {
  constexpr unsigned kSingleSegment = 0x20;
  if (frame.size() < 6 || (frame[4] & kSingleSegment) != 0) return 0;
  const uint64_t base = uint64_t{1} << (10 + (frame[5] >> 3));
  return base + base / 8 * (frame[5] & 7);
}

}  // namespace

bool ZstdDecompressor::decompress(ByteSpan frame, unsigned char* dst, size_t size) {
  // ZSTD_decompressDCtx would accept several frames in a row, skippable ones, and with some builds
  // those of versions before RFC 8878. The format allows one frame of that document.
  if (frame.size() < 4 || load_le<uint32_t>(frame.data()) != ZSTD_MAGICNUMBER) return false;
  if (window_bytes(frame) > kMaxZstdWindow) return false;
  if (ZSTD_findFrameCompressedSize(frame.data(), frame.size()) != frame.size()) return false;
  const size_t n = ZSTD_decompressDCtx(context_, dst, size, frame.data(), frame.size());
  return !ZSTD_isError(n) && n == size;
}

}  // namespace l4d
