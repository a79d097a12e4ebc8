// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/container/member.h"

#include <algorithm>
#include <string>

#include "l4d_generated.h"
#include "libl4dcodec/base/hash.h"
#include "libl4dcodec/container/aligned_bytes.h"
#include "libl4dcodec/container/flat_check.h"
#include "libl4dcodec/scene/timeline.h"

namespace l4d {
namespace {

constexpr char kMemberIdentifier[] = "L4DM";
constexpr char kEditIdentifier[] = "L4DE";

template <typename Table>
bool is_valid_buffer(const AlignedBytes& bytes, const char* identifier,
                     const flatbuffers::TypeTable* type) {
  flatbuffers::Verifier verifier(bytes.data(), bytes.size(), 16, 100000);
  return verifier.VerifyBuffer<Table>(identifier) &&
         tables_are_whole({bytes.data(), bytes.size()}, type);
}

Status check_needs(const Member& member, uint64_t base) {
  for (size_t i = 0; i < member.needs.size(); ++i) {
    const uint32_t number = member.needs[i];
    if (number >= member.number || (i > 0 && number <= member.needs[i - 1])) {
      return corrupt("MEMB-5", base, "needs that do not ascend, or not to members before");
    }
  }
  if (!member.needs.empty() && !member.is(MemberRole::kMedia)) {
    return corrupt("MEMB-5", base, "a member that needs others and is not media");
  }
  return {};
}

}  // namespace

std::vector<Extension> read_extensions(ByteSpan scene_header) {
  const AlignedBytes bytes(scene_header);
  std::vector<Extension> out;
  const auto* list = flatbuffers::GetRoot<fbs::Header>(bytes.data())->extensions();
  if (list == nullptr) return out;
  for (const fbs::Extension* e : *list) {
    Extension extension;
    extension.id = e->id();
    extension.critical = e->critical();
    if (e->chunk() != nullptr) {
      const fbs::ChunkRef& c = *e->chunk();
      extension.chunk = {c.offset(), c.hash(), c.stored_bytes(), c.raw_bytes(), c.codec()};
    }
    out.push_back(extension);
  }
  return out;
}

Bytes serialize_member(const Member& m) {
  flatbuffers::FlatBufferBuilder b(256);
  std::vector<fbs::MemberRecord> records;
  for (const MemberRecord& r : m.records) {
    records.emplace_back(r.offset, r.bytes, r.header_hash, r.begin, r.end, r.shift, r.number,
                         r.role, r.num_needs, 0);
  }
  const auto needs = m.needs.empty() ? 0 : b.CreateVector(m.needs);
  const auto list = m.records.empty() ? 0 : b.CreateVectorOfStructs(records);
  const auto record_needs = m.record_needs.empty() ? 0 : b.CreateVector(m.record_needs);
  b.Finish(fbs::CreateMember(b, m.stream, m.number, static_cast<uint8_t>(m.role), m.shift, needs,
                             list, record_needs),
           kMemberIdentifier);
  return Bytes(b.GetBufferPointer(), b.GetBufferPointer() + b.GetSize());
}

Bytes serialize_edit(const Edit& edit) {
  flatbuffers::FlatBufferBuilder b(64);
  b.Finish(fbs::CreateEdit(b, edit.begin, edit.end), kEditIdentifier);
  return Bytes(b.GetBufferPointer(), b.GetBufferPointer() + b.GetSize());
}

Status parse_member(ByteSpan unaligned, uint64_t base, Member* out) {
  const AlignedBytes bytes(unaligned);
  if (!is_valid_buffer<fbs::Member>(bytes, kMemberIdentifier, fbs::MemberTypeTable())) {
    return corrupt("MEMB-2", base, "the chunk of extension 1 is no valid FlatBuffer of its table");
  }
  const fbs::Member& m = *flatbuffers::GetRoot<fbs::Member>(bytes.data());
  *out = Member();
  out->stream = m.stream();
  out->number = m.number();
  out->role = m.role();
  out->shift = m.shift();
  if (!is_sound(out->shift)) return corrupt("MEMB-4", base, "shift is out of range");
  if (m.needs() != nullptr) out->needs.assign(m.needs()->begin(), m.needs()->end());
  L4D_RETURN_IF_ERROR(check_needs(*out, base));
  if (!out->is(MemberRole::kIndex)) return {};
  if (m.records() != nullptr) {
    for (const fbs::MemberRecord* r : *m.records()) {
      out->records.push_back({r->offset(), r->bytes(), r->header_hash(), r->begin(), r->end(),
                              r->shift(), r->number(), r->role(), r->num_needs()});
    }
  }
  if (m.record_needs() != nullptr) {
    out->record_needs.assign(m.record_needs()->begin(), m.record_needs()->end());
  }
  return {};
}

Status parse_edit(ByteSpan unaligned, uint64_t base, const l4d_timeline& timeline, Edit* out) {
  const AlignedBytes bytes(unaligned);
  if (!is_valid_buffer<fbs::Edit>(bytes, kEditIdentifier, fbs::EditTypeTable())) {
    return corrupt("MEMB-2", base, "the chunk of extension 2 is no valid FlatBuffer of its table");
  }
  const fbs::Edit& e = *flatbuffers::GetRoot<fbs::Edit>(bytes.data());
  *out = {e.begin(), e.end()};
  const double end = timeline.time_begin + sequence_duration(timeline);
  if (!(out->begin < out->end && out->begin >= timeline.time_begin && out->end <= end)) {
    return corrupt("MEMB-3", base, "an edit that is no part of the sequence");
  }
  return {};
}

void IndexFooter::append(Bytes& out) const {
  const size_t begin = out.size();
  out.insert(out.end(), kMagic.begin(), kMagic.end());
  append_le<uint64_t>(bytes, out);
  append_le<uint64_t>(hash64(ByteSpan(out.data() + begin, 16)), out);
}

bool IndexFooter::parse(ByteSpan footer, IndexFooter* out) {
  if (footer.size() != kBytes || !std::equal(kMagic.begin(), kMagic.end(), footer.begin()) ||
      load_le<uint64_t>(footer.data() + 16) != hash64(footer.subspan(0, 16))) {
    return false;
  }
  out->bytes = load_le<uint64_t>(footer.data() + 8);
  return true;
}

}  // namespace l4d
