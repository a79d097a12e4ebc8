// SPDX-License-Identifier: Apache-2.0
#include "decoder/copy/copy_stream.h"
#include "libl4dcodec/base/hash.h"

namespace l4d {
namespace {

// A stream with this header and without Gaussians, and `more` bytes that follow it and are counted
// as of it.
void append_empty(SceneHeader header, const Member& about, uint64_t more, Bytes* out) {
  const Bytes member = serialize_member(about);
  if (header.layers.empty()) {
    header.layers.resize(1);
    header.layers[0].permanent = true;
    header.layers[0].mean_t = CoordinateCodingId::kNone;
  }
  header.payload_offset = 1;
  Extension extension;
  extension.id = static_cast<uint32_t>(ExtensionId::kMember);
  extension.critical = !about.needs.empty();
  extension.chunk.hash = hash64(member);
  extension.chunk.stored_bytes = extension.chunk.raw_bytes = static_cast<uint32_t>(member.size());
  header.file_bytes = 1;
  const size_t header_bytes = serialize_scene_header(header, {extension}).size();
  extension.chunk.offset = FileHeader::kBytes + header_bytes;
  header.file_bytes = extension.chunk.offset + member.size() + more;
  const Bytes scene_header = serialize_scene_header(header, {extension});

  FileHeader file;
  file.flags = FileHeader::kDevelopmentFlag;
  file.header_bytes = static_cast<uint32_t>(header_bytes);
  file.header_hash = hash64(scene_header);
  file.append(*out);
  out->insert(out->end(), scene_header.begin(), scene_header.end());
  out->insert(out->end(), member.begin(), member.end());
}

Member index_of(const MemberList& list) {
  Member index;
  index.stream = list.stream();
  index.number = list.members().back().number + 1;
  index.role = static_cast<uint32_t>(MemberRole::kIndex);
  for (const ListedMember& m : list.members()) {
    index.records.push_back(
        {m.offset, m.bytes, m.header_hash, m.begin, m.end, m.shift, m.number, m.role, m.num_needs});
  }
  index.record_needs = list.needs();
  return index;
}

}  // namespace

Status make_index(const MemberList& list, Bytes* out) {
  if (list.members().back().is(MemberRole::kIndex)) {
    return invalid_argument("the file has an index already");
  }
  if (list.members().back().number == UINT32_MAX) {
    return invalid_argument("no number is left for an index");
  }
  out->clear();
  SceneHeader header;
  header.timeline = {0, 1, 1, 1, 0};
  append_empty(header, index_of(list), IndexFooter::kBytes, out);
  IndexFooter{out->size() + IndexFooter::kBytes}.append(*out);
  return {};
}

void make_empty_member(const SceneHeader& like, const Member& member, Bytes* out) {
  out->clear();
  append_empty(like, member, 0, out);
}

}  // namespace l4d
