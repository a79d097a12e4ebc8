// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

#include "libl4dcodec/base/bytes.h"
#include "libl4dcodec/base/status.h"

namespace l4d {

// The first 40 bytes of a file (spec: "File header").
struct FileHeader {
  static constexpr size_t kBytes = 40;
  static constexpr std::array<unsigned char, 8> kMagic = {0x89, 'L',  '4',  'D',
                                                          0x0d, 0x0a, 0x1a, 0x0a};
  static constexpr uint16_t kDevelopmentFlag = 1u << 0;
  static constexpr uint16_t kStreamableFlag = 1u << 2;  // of writers, for readers who care
  static constexpr uint16_t kIgnoredFlags = 0x00fe;     // a decoder does not look at these
  static constexpr uint16_t kRejectedFlags = 0xff00;    // a decoder refuses a file that sets one

  uint8_t version_major = L4D_BITSTREAM_MAJOR;
  uint8_t version_minor = L4D_BITSTREAM_MINOR;
  uint16_t flags = 0;
  uint32_t header_bytes = 0;
  uint64_t header_offset = kBytes;
  uint64_t header_hash = 0;

  void append(Bytes& out) const;
  // `bytes` holds the first kBytes of the file, or all of a shorter one.
  static Status parse(ByteSpan bytes, FileHeader* out);
};

}  // namespace l4d
