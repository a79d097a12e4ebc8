// SPDX-License-Identifier: Apache-2.0
#include "decoder/read/member_list.h"

#include <algorithm>
#include <string>

#include "libl4dcodec/base/hash.h"
#include "libl4dcodec/scene/timeline.h"

namespace l4d {
namespace {

bool is_of_host(const Status& status) {
  return status.code() == L4D_ERR_IO || status.code() == L4D_ERR_OUT_OF_MEMORY ||
         status.code() == L4D_ERR_LIMIT_EXCEEDED;
}

Status at_member(const Status& status, uint64_t offset) {
  const uint64_t at = status.offset() == Status::kNoOffset ? offset : offset + status.offset();
  return Status(status.code(), status.clause(), at, status.message());
}

bool is_same(const ListedMember& a, const ListedMember& b) {
  return a.offset == b.offset && a.bytes == b.bytes && a.header_hash == b.header_hash &&
         a.begin == b.begin && a.end == b.end && a.shift == b.shift && a.number == b.number &&
         a.role == b.role && a.num_needs == b.num_needs;
}

ListedMember listed(const MemberRecord& r) {
  ListedMember m;
  m.offset = r.offset;
  m.bytes = r.bytes;
  m.header_hash = r.header_hash;
  m.begin = r.begin;
  m.end = r.end;
  m.shift = r.shift;
  m.sequence_begin = r.begin - r.shift;
  m.sequence_end = r.end - r.shift;
  m.number = r.number;
  m.role = r.role;
  m.num_needs = r.num_needs;
  return m;
}

}  // namespace

void MemberList::clear() {
  members_.clear();
  needs_.clear();
  held_.shrink_to(0);
  stream_ = 0;
  has_media_ = false;
  has_frame_ = false;
  is_from_index_ = false;
  rest_ = Status();
}

Status MemberList::find_signature(uint64_t offset, bool* found) {
  *found = false;
  if (source_.size() - offset != kSignatureBytes) return {};
  Bytes storage;
  ByteSpan bytes;
  L4D_RETURN_IF_ERROR(source_.read(offset, kSignatureMagic.size(), storage, &bytes));
  *found = std::equal(kSignatureMagic.begin(), kSignatureMagic.end(), bytes.begin());
  return {};
}

Status MemberList::read_chunk(const ListedMember& member, const Extension& extension, Bytes* out) {
  const ChunkRef& chunk = extension.chunk;
  const uint64_t at = member.offset + chunk.offset;
  if (chunk.offset > member.bytes || chunk.stored_bytes > member.bytes - chunk.offset) {
    return Status(
        L4D_ERR_TRUNCATED, "CHNK-1", member.offset,
        "the chunk of extension " + std::to_string(extension.id) + " does not lie in its member");
  }
  if (chunk.codec != 0 || chunk.stored_bytes != chunk.raw_bytes ||
      chunk.stored_bytes > kMaxExtensionBytes) {
    return corrupt("MEMB-2", at, "the chunk of an extension is coded, or too large");
  }
  Bytes storage;
  ByteSpan bytes;
  L4D_RETURN_IF_ERROR(source_.read(at, chunk.stored_bytes, storage, &bytes));
  if (hash64(bytes) != chunk.hash) {
    return Status(L4D_ERR_CHECKSUM, "CHNK-2", at, "checksum of a chunk does not match");
  }
  out->assign(bytes.begin(), bytes.end());
  return {};
}

Status MemberList::read_extensions_of(MemberHeader* out) {
  Bytes chunk;
  for (const Extension& e : out->extensions) {
    const bool is_member = e.id == static_cast<uint32_t>(ExtensionId::kMember);
    const bool is_edit = e.id == static_cast<uint32_t>(ExtensionId::kEdit);
    if (!is_member && !is_edit) continue;
    if (is_member ? out->has_extension : out->has_edit) {
      return corrupt("MEMB-1", out->listed.offset, "an extension occurs twice");
    }
    MemoryCharge charge(memory_);
    // As it is read, aligned, and as it is parsed.
    L4D_RETURN_IF_ERROR(charge.take(4 * uint64_t{e.chunk.stored_bytes}, "an extension"));
    L4D_RETURN_IF_ERROR(read_chunk(out->listed, e, &chunk));
    const uint64_t at = out->listed.offset + e.chunk.offset;
    out->chunks.push_back(e.chunk);
    if (is_edit) {
      L4D_RETURN_IF_ERROR(parse_edit(chunk, at, out->scene.timeline, &out->edit));
      out->has_edit = true;
      continue;
    }
    L4D_RETURN_IF_ERROR(parse_member(chunk, at, &out->member));
    out->has_extension = true;
    if (!out->member.needs.empty() && !e.critical) {
      return corrupt("MEMB-5", at, "a member that needs others, and is not critical");
    }
  }
  return {};
}

Status MemberList::read_header(uint64_t offset, MemberHeader* out) {
  *out = MemberHeader();
  const uint64_t rest = source_.size() - offset;
  const uint64_t head_bytes = std::min<uint64_t>(rest, FileHeader::kBytes);
  if (!source_.is_fetched(offset, head_bytes)) {
    source_.forget();
    source_.fetch({{offset, std::min(rest, source_.block_bytes())}}, FetchedFor::kStream, memory_);
  }
  Bytes storage;
  ByteSpan bytes;
  L4D_RETURN_IF_ERROR(source_.read(offset, head_bytes, storage, &bytes));
  FileHeader& head = out->file_header;
  const Status parsed = FileHeader::parse(bytes, &head);
  if (!parsed.ok()) return at_member(parsed, offset);
  ListedMember& m = out->listed;
  m.offset = offset;
  m.header_hash = load_le<uint64_t>(bytes.data() + 32);
  if (head.header_offset > rest || head.header_bytes > rest - head.header_offset) {
    return Status(L4D_ERR_TRUNCATED, "CHNK-1", offset, "the file ends before the scene header");
  }
  MemoryCharge charge(memory_);
  L4D_RETURN_IF_ERROR(charge.take(head.header_bytes, "the scene header"));
  const uint64_t at = offset + head.header_offset;
  L4D_RETURN_IF_ERROR(source_.read(at, head.header_bytes, storage, &bytes));
  if (hash64(bytes) != head.header_hash) {
    return Status(L4D_ERR_CHECKSUM, "FILE-6", at, "checksum of the scene header does not match");
  }
  L4D_RETURN_IF_ERROR(parse_scene_header(bytes, at, &out->scene));
  m.bytes = out->scene.file_bytes > 0 ? out->scene.file_bytes : rest;
  if (m.bytes > rest) {
    return Status(L4D_ERR_TRUNCATED, "HEAD-21", offset,
                  "a stream of " + std::to_string(m.bytes) + " bytes, of which " +
                      std::to_string(rest) + " are there");
  }
  // So no byte is read for two members.
  if (head.header_offset > m.bytes || head.header_bytes > m.bytes - head.header_offset) {
    return Status(L4D_ERR_TRUNCATED, "HEAD-21", offset, "the scene header lies behind its stream");
  }
  out->extensions = read_extensions(bytes);
  L4D_RETURN_IF_ERROR(read_extensions_of(out));
  const l4d_timeline& timeline = out->scene.timeline;
  if (!out->has_extension) {
    out->member.stream = stream_;
    out->member.number = members_.empty() ? 0 : members_.back().number + 1;
  }
  m.number = out->member.number;
  m.role = out->member.role;
  m.shift = out->member.shift;
  m.num_needs = static_cast<uint32_t>(out->member.needs.size());
  const double sequence_end = timeline.time_begin + sequence_duration(timeline);
  m.sequence_begin = out->has_edit ? out->edit.begin : timeline.time_begin;
  m.sequence_end = out->has_edit ? out->edit.end : sequence_end;
  m.begin = m.sequence_begin + m.shift;
  m.end = m.sequence_end + m.shift;
  return {};
}

Status MemberList::append(const ListedMember& m, const std::vector<uint32_t>& needs) {
  if (members_.size() >= kMaxMembers) {
    return Status(L4D_ERR_LIMIT_EXCEEDED,
                  "a file of more than " + std::to_string(kMaxMembers) + " members");
  }
  if (!members_.empty() && m.number <= members_.back().number) {
    return corrupt("MEMB-6", m.offset, "the numbers of members do not ascend");
  }
  for (const uint32_t number : needs) {
    const auto before = [](const ListedMember& a, uint32_t b) { return a.number < b; };
    const auto it = std::lower_bound(members_.begin(), members_.end(), number, before);
    const bool found = it != members_.end() && it->number == number;
    if (found ? it->is(MemberRole::kStanding)
              : number < (members_.empty() ? m.number : members_.front().number)) {
      continue;
    }
    return corrupt("MEMB-7", m.offset,
                   "member " + std::to_string(m.number) + " needs member " +
                       std::to_string(number) + ", which is no standing one before it");
  }
  if (m.is(MemberRole::kMedia)) {
    if (!(m.begin < m.end) || (has_media_ && m.begin < media_end_)) {
      return corrupt("MEMB-8", m.offset,
                     "the span of member " + std::to_string(m.number) + " overlaps one before it");
    }
    media_end_ = m.end;
    has_media_ = true;
  }
  // A vector that grows holds the old elements, the new ones and room for as many again.
  const uint64_t bytes = 3 * (sizeof(ListedMember) + needs.size() * sizeof(uint32_t));
  L4D_RETURN_IF_ERROR(held_.take(bytes, "the list of members"));
  members_.push_back(m);
  members_.back().first_need = needs_.size();
  needs_.insert(needs_.end(), needs.begin(), needs.end());
  return {};
}

Status MemberList::check_frame(const MemberHeader& header) {
  if (header.member.is(MemberRole::kIndex)) return {};
  const SceneFrame frame = {header.scene.placement, header.scene.rendering};
  const char* other = has_frame_ ? difference(frame_, frame) : nullptr;
  if (other != nullptr) {
    return corrupt("MEMB-11", header.listed.offset,
                   "member " + std::to_string(header.listed.number) + " has another " + other +
                       " than those before");
  }
  frame_ = frame;
  has_frame_ = true;
  return {};
}

Status MemberList::walk() {
  clear();
  const uint64_t size = source_.size();
  MemberHeader header;
  for (uint64_t offset = 0; offset < size || offset == 0; offset = end()) {
    bool is_signature = false;
    if (offset > 0) L4D_RETURN_IF_ERROR(find_signature(offset, &is_signature));
    if (is_signature) break;
    Status status = read_header(offset, &header);
    if (status.ok() && offset > 0 && header.member.stream != stream_) {
      status = corrupt("MEMB-6", offset, "members of two streams");
    }
    if (status.ok()) status = check_frame(header);
    if (status.ok()) status = append(header.listed, header.member.needs);
    if (status.ok()) {
      stream_ = header.member.stream;
      continue;
    }
    if (members_.empty() || is_of_host(status)) return status;
    if (status.code() == L4D_ERR_NOT_L4D) {
      status = corrupt("MEMB-6", offset, "what lies behind a member is no member");
    }
    rest_ = status;
    break;
  }
  source_.forget();
  return {};
}

Status MemberList::take_records(const MemberHeader& index) {
  const Member& m = index.member;
  size_t first_need = 0;
  for (const MemberRecord& r : m.records) {
    if (r.offset != end() || r.bytes < FileHeader::kBytes ||
        r.bytes > index.listed.offset - r.offset || !is_sound(r.shift) ||
        r.num_needs > m.record_needs.size() - first_need) {
      return corrupt("MEMB-9", index.listed.offset, "a record of an index that is of no member");
    }
    const std::vector<uint32_t> needs(
        m.record_needs.begin() + static_cast<std::ptrdiff_t>(first_need),
        m.record_needs.begin() + static_cast<std::ptrdiff_t>(first_need + r.num_needs));
    first_need += r.num_needs;
    L4D_RETURN_IF_ERROR(append(listed(r), needs));
  }
  if (first_need != m.record_needs.size() || end() != index.listed.offset) {
    return corrupt("MEMB-9", index.listed.offset, "an index does not list all members");
  }
  stream_ = m.stream;
  return append(index.listed, {});
}

Status MemberList::read_index(bool* found) {
  *found = false;
  uint64_t size = source_.size();
  if (size > kSignatureBytes) {
    bool is_signed = false;
    L4D_RETURN_IF_ERROR(find_signature(size - kSignatureBytes, &is_signed));
    if (is_signed) size -= kSignatureBytes;
  }
  if (size < IndexFooter::kBytes) return {};
  const uint64_t block = std::min(size, source_.block_bytes());
  source_.fetch({{size - block, block}}, FetchedFor::kStream, memory_);
  Bytes storage;
  ByteSpan bytes;
  IndexFooter footer;
  L4D_RETURN_IF_ERROR(
      source_.read(size - IndexFooter::kBytes, IndexFooter::kBytes, storage, &bytes));
  if (!IndexFooter::parse(bytes, &footer) || footer.bytes >= size) return {};
  MemberHeader index;
  const Status status = read_header(size - footer.bytes, &index);
  if (!status.ok()) return is_of_host(status) ? status : Status();
  if (!index.member.is(MemberRole::kIndex) || index.listed.bytes != footer.bytes) return {};
  const Status taken = take_records(index);
  if (!taken.ok()) {
    clear();
    return taken.code() == L4D_ERR_LIMIT_EXCEEDED ? taken : Status();
  }
  *found = is_from_index_ = true;
  return {};
}

Status MemberList::read() {
  clear();
  bool found = false;
  L4D_RETURN_IF_ERROR(read_index(&found));
  source_.forget();
  return found ? Status() : walk();
}

Status MemberList::check_header(const ListedMember& member) {
  Bytes storage;
  ByteSpan bytes;
  L4D_RETURN_IF_ERROR(source_.read(member.offset, FileHeader::kBytes, storage, &bytes));
  if (load_le<uint64_t>(bytes.data() + 32) == member.header_hash &&
      hash64(bytes.subspan(0, 32)) == member.header_hash) {
    return {};
  }
  return Status(L4D_ERR_CHECKSUM, "MEMB-9", member.offset,
                "the file header is not that of the member that the index lists");
}

Status MemberList::check_index() {
  if (members_.empty() || !members_.back().is(MemberRole::kIndex)) return {};
  MemberHeader index;
  const ListedMember& last = members_.back();
  L4D_RETURN_IF_ERROR(read_header(last.offset, &index));
  const Member& m = index.member;
  bool holds = m.records.size() == members_.size() - 1 && m.record_needs == needs_;
  for (size_t i = 0; holds && i < m.records.size(); ++i) {
    holds = is_same(listed(m.records[i]), members_[i]);
  }
  if (!holds) return corrupt("MEMB-9", last.offset, "an index says what its file is not");
  Bytes storage;
  ByteSpan bytes;
  IndexFooter footer;
  if (last.bytes < IndexFooter::kBytes) {
    return corrupt("MEMB-10", last.offset, "an index without its footer");
  }
  L4D_RETURN_IF_ERROR(
      source_.read(end() - IndexFooter::kBytes, IndexFooter::kBytes, storage, &bytes));
  if (!IndexFooter::parse(bytes, &footer) || footer.bytes != last.bytes) {
    return corrupt("MEMB-10", end() - IndexFooter::kBytes, "an index without its footer");
  }
  return {};
}

l4d_reader MemberReader::reader() {
  l4d_reader out = inner_;
  out.struct_size = sizeof out;
  out.user = this;
  out.read_at = &read_at;
  out.size = &size;
  out.read_many = inner_.read_many != nullptr ? &read_many : nullptr;
  return out;
}

int64_t MemberReader::read_at(void* user, void* dst, size_t n, uint64_t offset) {
  const auto& member = *static_cast<MemberReader*>(user);
  if (offset > member.bytes_) return -1;
  const uint64_t left = member.bytes_ - offset;
  return member.inner_.read_at(member.inner_.user, dst,
                               static_cast<size_t>(std::min<uint64_t>(n, left)),
                               member.offset_ + offset);
}

int64_t MemberReader::size(void* user) {
  return static_cast<int64_t>(static_cast<MemberReader*>(user)->bytes_);
}

int MemberReader::read_many(void* user, const l4d_read* reads, size_t count) {
  const auto& member = *static_cast<MemberReader*>(user);
  std::vector<l4d_read> moved(reads, reads + count);
  for (l4d_read& r : moved) {
    if (r.offset > member.bytes_ || r.size > member.bytes_ - r.offset) return -1;
    r.offset += member.offset_;
  }
  return member.inner_.read_many(member.inner_.user, moved.data(), count);
}

namespace {

const ListedMember* media_at(const std::vector<ListedMember>& members, double time) {
  const ListedMember* before = nullptr;
  for (const ListedMember& m : members) {
    if (!m.is(MemberRole::kMedia)) continue;
    if (m.begin > time) {
      return before == nullptr || (time >= before->end && m.begin - time < time - before->end)
                 ? &m
                 : before;
    }
    before = &m;
  }
  return before;
}

}  // namespace

Status find_shown(const std::vector<ListedMember>& members, const std::vector<uint32_t>& needs,
                  double time, std::vector<uint32_t>* out) {
  const ListedMember* media = media_at(members, time);
  if (media == nullptr) return {};
  out->push_back(static_cast<uint32_t>(media - members.data()));
  for (uint32_t k = 0; k < media->num_needs; ++k) {
    const uint32_t number = needs[media->first_need + k];
    const auto it =
        std::lower_bound(members.begin(), members.end(), number,
                         [](const ListedMember& m, uint32_t n) { return m.number < n; });
    if (it == members.end() || it->number != number) {
      return Status(L4D_ERR_TRUNCATED, "MEMB-7", media->offset,
                    "member " + std::to_string(media->number) + " needs member " +
                        std::to_string(number) + ", which is not in this file");
    }
    out->push_back(static_cast<uint32_t>(it - members.begin()));
  }
  return {};
}

}  // namespace l4d
