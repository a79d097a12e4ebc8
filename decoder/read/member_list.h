// SPDX-License-Identifier: Apache-2.0
// The members of a file (spec: section 20.2), and readers of one of them.
#pragma once

#include <vector>

#include "decoder/read/source.h"
#include "libl4dcodec/container/file_header.h"
#include "libl4dcodec/container/member.h"
#include "libl4dcodec/scene/frame.h"

namespace l4d {

struct ListedMember {
  uint64_t offset = 0;
  uint64_t bytes = 0;
  uint64_t header_hash = 0;
  double begin = 0;  // of its span
  double end = 0;
  double sequence_begin = 0;  // of what it presents, less the shift
  double sequence_end = 0;
  double shift = 0;
  uint32_t number = 0;
  uint32_t role = 0;
  uint32_t num_needs = 0;
  size_t first_need = 0;  // in MemberList::needs()

  bool is(MemberRole r) const { return role == static_cast<uint32_t>(r); }
};

// Indices of what shows a time: the media member, the last one that begins by then or the one after
// it if that is nearer, then those that it needs. Empty if there is no media member. Members are in
// the order of their numbers and spans; `needs` holds numbers.
Status find_shown(const std::vector<ListedMember>& members, const std::vector<uint32_t>& needs,
                  double time, std::vector<uint32_t>* out);

// What a member says of itself: its headers, and the chunks of extensions that members have.
struct MemberHeader {
  ListedMember listed;
  Member member;
  bool has_extension = false;  // `member` is what a chunk says
  bool has_edit = false;
  Edit edit;
  std::vector<ChunkRef> chunks;  // of extensions 1 and 2
  FileHeader file_header;
  SceneHeader scene;
  std::vector<Extension> extensions;
};

class MemberList {
 public:
  // More members than a writer of 2 second members makes in 24 days.
  static constexpr size_t kMaxMembers = size_t{1} << 20;

  // memory: of the list, and of what is read of one member at a time.
  MemberList(ByteSource& source, MemoryBudget& memory) : source_(source), memory_(memory) {}

  // Takes the list of the index at the end of the file, or else walks.
  Status read();
  // From header to header. Fails where the first member is not whole, or the reader fails;
  // elsewhere the list ends at the first member that is not whole or breaks a rule.
  Status walk();

  const std::vector<ListedMember>& members() const { return members_; }
  const std::vector<uint32_t>& needs() const { return needs_; }
  uint64_t stream() const { return stream_; }
  bool is_from_index() const { return is_from_index_; }
  // OK, or why the list ends before the file.
  const Status& rest() const { return rest_; }
  uint64_t end() const {
    return members_.empty() ? 0 : members_.back().offset + members_.back().bytes;
  }

  // Reads the headers of the member at `offset`, which follows the members before.
  Status read_header(uint64_t offset, MemberHeader* out);
  // Whether a member of an index is still there, by its file header.
  Status check_header(const ListedMember& member);
  // MEMB-9 and MEMB-10, of a list that was walked.
  Status check_index();

 private:
  // Adds a member that keeps the rules of members after those before it.
  Status append(const ListedMember& member, const std::vector<uint32_t>& needs);
  // MEMB-11, of a member that follows those that were walked.
  Status check_frame(const MemberHeader& header);
  Status read_chunk(const ListedMember& member, const Extension& extension, Bytes* out);
  Status read_extensions_of(MemberHeader* out);
  Status read_index(bool* found);
  Status take_records(const MemberHeader& index);
  // Where the members end: before a signature.
  Status find_signature(uint64_t offset, bool* found);
  void clear();

  ByteSource& source_;
  MemoryBudget& memory_;
  MemoryCharge held_{memory_};  // for members_ and needs_
  std::vector<ListedMember> members_;
  std::vector<uint32_t> needs_;
  uint64_t stream_ = 0;
  double media_end_ = 0;  // of the last span
  bool has_media_ = false;
  SceneFrame frame_;  // of the members that were walked
  bool has_frame_ = false;
  bool is_from_index_ = false;
  Status rest_;
};

// A reader of `bytes` bytes of another one, from `offset` on. It is used by address, and outlives
// the reader that it gives.
class MemberReader {
 public:
  MemberReader(const l4d_reader& reader, uint64_t offset, uint64_t bytes)
      : inner_(reader), offset_(offset), bytes_(bytes) {}
  l4d_reader reader();

 private:
  static int64_t read_at(void* user, void* dst, size_t n, uint64_t offset);
  static int64_t size(void* user);
  static int read_many(void* user, const l4d_read* reads, size_t count);

  l4d_reader inner_;
  uint64_t offset_;
  uint64_t bytes_;
};

}  // namespace l4d
