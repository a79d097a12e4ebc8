// SPDX-License-Identifier: Apache-2.0
// What a zstd frame of a stream may be.
#include <gtest/gtest.h>
#include <zstd.h>

#include "libl4dcodec/entropy/zstd_codec.h"

namespace l4d {
namespace {

// A frame of one raw block, with a Window_Descriptor and neither content size nor checksum.
Bytes frame_of(const Bytes& content, uint8_t window_descriptor) {
  Bytes frame = {0x28, 0xb5, 0x2f, 0xfd, 0x00, window_descriptor};
  const uint32_t block = static_cast<uint32_t>(content.size() << 3) | 1u;  // last, raw
  for (int k = 0; k < 3; ++k) frame.push_back(static_cast<unsigned char>(block >> (8 * k)));
  frame.insert(frame.end(), content.begin(), content.end());
  return frame;
}

const Bytes kContent = {1, 2, 3, 4, 5};

bool decodes(const Bytes& frame) {
  Bytes out(kContent.size());
  return ZstdDecompressor().decompress(frame, out.data(), out.size()) && out == kContent;
}

// spec: CHNK-5
TEST(Zstd, WindowsAreBounded) {
  constexpr uint8_t kLargest = 16 << 3;  // 2^26 bytes
  EXPECT_TRUE(decodes(frame_of(kContent, 0)));
  EXPECT_TRUE(decodes(frame_of(kContent, 13 << 3)));
  EXPECT_TRUE(decodes(frame_of(kContent, kLargest)));
  EXPECT_FALSE(decodes(frame_of(kContent, kLargest + 1)));
  EXPECT_FALSE(decodes(frame_of(kContent, 17 << 3)));
  EXPECT_FALSE(decodes(frame_of(kContent, 0xff)));
}

// spec: CHNK-5
TEST(Zstd, ContentChecksumsAreVerified) {
  ZSTD_CCtx* context = ZSTD_createCCtx();
  ASSERT_NE(context, nullptr);
  ZSTD_CCtx_setParameter(context, ZSTD_c_checksumFlag, 1);
  Bytes frame(ZSTD_compressBound(kContent.size()));
  frame.resize(
      ZSTD_compress2(context, frame.data(), frame.size(), kContent.data(), kContent.size()));
  ZSTD_freeCCtx(context);
  EXPECT_TRUE(decodes(frame));
  for (size_t k = 1; k <= 4; ++k) {
    Bytes damaged = frame;
    damaged[damaged.size() - k] ^= 1;
    EXPECT_FALSE(decodes(damaged));
  }
}

}  // namespace
}  // namespace l4d
