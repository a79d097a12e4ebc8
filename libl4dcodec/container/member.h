// SPDX-License-Identifier: Apache-2.0
// What a stream says of itself as one of several in a file (spec: sections 20.1 to 20.3): the
// chunks of the extensions `member` and `edit`, and the footer of an index.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "libl4dcodec/container/scene_header.h"

namespace l4d {

enum class MemberRole : uint32_t { kMedia = 0, kStanding = 1, kIndex = 2 };
constexpr uint64_t kMaxExtensionBytes = uint64_t{1} << 27;

// Of a scene header that parse_scene_header has accepted.
std::vector<Extension> read_extensions(ByteSpan scene_header);

struct MemberRecord {
  uint64_t offset = 0;
  uint64_t bytes = 0;
  uint64_t header_hash = 0;
  double begin = 0;
  double end = 0;
  double shift = 0;
  uint32_t number = 0;
  uint32_t role = 0;
  uint32_t num_needs = 0;
};

struct Member {
  uint64_t stream = 0;
  uint32_t number = 0;
  uint32_t role = 0;  // MemberRole, or of a later version
  double shift = 0;
  std::vector<uint32_t> needs;
  std::vector<MemberRecord> records;   // of an index
  std::vector<uint32_t> record_needs;  // of an index

  bool is(MemberRole r) const { return role == static_cast<uint32_t>(r); }
};

struct Edit {
  double begin = 0;
  double end = 0;
};

Bytes serialize_member(const Member& member);
Bytes serialize_edit(const Edit& edit);
// `base`: file offset of the bytes, for messages. Check what needs no other part of the file.
Status parse_member(ByteSpan bytes, uint64_t base, Member* out);
Status parse_edit(ByteSpan bytes, uint64_t base, const l4d_timeline& timeline, Edit* out);

// The last bytes of an index.
struct IndexFooter {
  static constexpr size_t kBytes = 24;
  static constexpr std::array<unsigned char, 8> kMagic = {'L', '4', 'D', 'I', 'N', 'D', 'E', 'X'};

  uint64_t bytes = 0;  // of the index

  void append(Bytes& out) const;
  // Whether the kBytes given are one.
  static bool parse(ByteSpan bytes, IndexFooter* out);
};

// Behind a file may be a signature of all bytes before it (spec: section 22.1).
constexpr size_t kSignatureBytes = 100;
constexpr std::array<unsigned char, 4> kSignatureMagic = {'L', '4', 'D', 'S'};

}  // namespace l4d
