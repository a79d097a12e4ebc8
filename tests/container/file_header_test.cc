// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/container/file_header.h"

#include <gtest/gtest.h>

#include "libl4dcodec/base/hash.h"

namespace l4d {
namespace {

FileHeader example() {
  FileHeader h;
  h.version_minor = 7;  // a newer minor version is read
  h.flags = FileHeader::kDevelopmentFlag | 0x00fe;
  h.header_bytes = 1234;
  h.header_offset = 0x0123456789abcdefu;
  h.header_hash = 0xfedcba9876543210u;
  return h;
}

Bytes written(const FileHeader& h) {
  Bytes out;
  h.append(out);
  return out;
}

void repair(Bytes& b) { store_le<uint64_t>(hash64(ByteSpan(b.data(), 32)), b.data() + 32); }

// spec: VER-1
TEST(FileHeader, RoundTrip) {
  const Bytes bytes = written(example());
  ASSERT_EQ(bytes.size(), FileHeader::kBytes);
  FileHeader h;
  ASSERT_TRUE(FileHeader::parse(bytes, &h).ok());
  EXPECT_EQ(h.version_major, L4D_BITSTREAM_MAJOR);
  EXPECT_EQ(h.version_minor, 7);
  EXPECT_EQ(h.flags, 0x00ff);
  EXPECT_EQ(h.header_bytes, 1234u);
  EXPECT_EQ(h.header_offset, 0x0123456789abcdefu);
  EXPECT_EQ(h.header_hash, 0xfedcba9876543210u);
}

TEST(FileHeader, AppendsBehindWhatIsThere) {
  Bytes out(3, 0x55);
  example().append(out);
  ASSERT_EQ(out.size(), 3 + FileHeader::kBytes);
  FileHeader h;
  EXPECT_TRUE(FileHeader::parse(ByteSpan(out.data() + 3, FileHeader::kBytes), &h).ok());
}

// spec: FILE-1
TEST(FileHeader, EveryPrefixIsRefused) {
  const Bytes bytes = written(example());
  for (size_t n = 0; n < bytes.size(); ++n) {
    FileHeader h;
    const Status s = FileHeader::parse(ByteSpan(bytes.data(), n), &h);
    EXPECT_EQ(s.code(), n == 0 ? L4D_ERR_NOT_L4D : L4D_ERR_TRUNCATED) << n;
    EXPECT_STREQ(s.clause(), "FILE-1") << n;
  }
}

// spec: FILE-4
TEST(FileHeader, EveryBitIsProtected) {
  const Bytes bytes = written(example());
  for (size_t bit = 0; bit < 8 * bytes.size(); ++bit) {
    Bytes damaged = bytes;
    damaged[bit / 8] = static_cast<unsigned char>(damaged[bit / 8] ^ (1u << (bit % 8)));
    FileHeader h;
    const Status s = FileHeader::parse(damaged, &h);
    EXPECT_EQ(s.code(), bit < 64 ? L4D_ERR_NOT_L4D : L4D_ERR_CHECKSUM) << "bit " << bit;
  }
}

// spec: FILE-2
TEST(FileHeader, RefusesOtherMajorVersions) {
  for (const int major : {0, 2, 255}) {
    FileHeader h = example();
    h.version_major = static_cast<uint8_t>(major);
    const Status s = FileHeader::parse(written(h), &h);
    EXPECT_EQ(s.code(), L4D_ERR_VERSION_UNSUPPORTED);
    EXPECT_STREQ(s.clause(), "FILE-2");
    EXPECT_NE(s.message().find(std::to_string(major) + ".7"), std::string::npos) << s.message();
  }
}

// spec: FILE-3, VER-2
TEST(FileHeader, RefusesEachReservedFlagAndIgnoresTheOthers) {
  for (unsigned bit = 0; bit < 16; ++bit) {
    FileHeader h = example();
    h.flags = static_cast<uint16_t>(1u << bit);
    const Status s = FileHeader::parse(written(h), &h);
    if (bit < 8) {
      EXPECT_TRUE(s.ok()) << bit;
    } else {
      EXPECT_EQ(s.code(), L4D_ERR_FEATURE_UNSUPPORTED) << bit;
      EXPECT_STREQ(s.clause(), "FILE-3") << bit;
    }
  }
}

// spec: FILE-5
TEST(FileHeader, RefusesAnImpossiblePlaceOfTheSceneHeader) {
  Bytes inside = written(example());
  store_le<uint64_t>(FileHeader::kBytes - 1, inside.data() + 16);
  repair(inside);
  Bytes empty = written(example());
  store_le<uint32_t>(0, empty.data() + 12);
  repair(empty);
  for (const Bytes& bytes : {inside, empty}) {
    FileHeader h;
    const Status s = FileHeader::parse(bytes, &h);
    EXPECT_EQ(s.code(), L4D_ERR_CORRUPT);
    EXPECT_STREQ(s.clause(), "FILE-5");
  }
}

}  // namespace
}  // namespace l4d
