// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/container/file_header.h"

#include <algorithm>
#include <string>

#include "libl4dcodec/base/hash.h"

namespace l4d {

void FileHeader::append(Bytes& out) const {
  const size_t begin = out.size();
  out.insert(out.end(), kMagic.begin(), kMagic.end());
  append_le<uint8_t>(version_major, out);
  append_le<uint8_t>(version_minor, out);
  append_le<uint16_t>(flags, out);
  append_le<uint32_t>(header_bytes, out);
  append_le<uint64_t>(header_offset, out);
  append_le<uint64_t>(header_hash, out);
  append_le<uint64_t>(hash64(ByteSpan(out.data() + begin, 32)), out);
}

Status FileHeader::parse(ByteSpan bytes, FileHeader* out) {
  const size_t magic_bytes = std::min(bytes.size(), kMagic.size());
  if (magic_bytes == 0 ||
      !std::equal(kMagic.begin(), kMagic.begin() + magic_bytes, bytes.begin())) {
    return Status(L4D_ERR_NOT_L4D, "FILE-1", 0, "the magic of an .l4d file is missing");
  }
  if (bytes.size() < kBytes) {
    return Status(L4D_ERR_TRUNCATED, "FILE-1", bytes.size(),
                  "the file ends within the file header");
  }
  FileHeader h;
  h.version_major = bytes[8];
  h.version_minor = bytes[9];
  h.flags = load_le<uint16_t>(bytes.data() + 10);
  h.header_bytes = load_le<uint32_t>(bytes.data() + 12);
  h.header_offset = load_le<uint64_t>(bytes.data() + 16);
  h.header_hash = load_le<uint64_t>(bytes.data() + 24);
  // The hash comes first: a damaged version byte is damage, not a newer version.
  if (load_le<uint64_t>(bytes.data() + 32) != hash64(bytes.subspan(0, 32))) {
    return Status(L4D_ERR_CHECKSUM, "FILE-4", 32, "checksum of the file header does not match");
  }
  if (h.version_major != L4D_BITSTREAM_MAJOR) {
    return Status(L4D_ERR_VERSION_UNSUPPORTED, "FILE-2", 8,
                  "bitstream version " + std::to_string(h.version_major) + "." +
                      std::to_string(h.version_minor) + "; this library reads version " +
                      std::to_string(L4D_BITSTREAM_MAJOR));
  }
  if ((h.flags & kRejectedFlags) != 0) {
    return Status(L4D_ERR_FEATURE_UNSUPPORTED, "FILE-3", 10, "reserved flag bits are set");
  }
  if (h.header_offset < kBytes || h.header_bytes == 0) {
    return corrupt("FILE-5", 12, "scene header at an impossible place");
  }
  *out = h;
  return {};
}

}  // namespace l4d
