// SPDX-License-Identifier: Apache-2.0
// Files of several streams, as commands read and write them.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "cli/command/context.h"
#include "cli/input/files.h"
#include "cli/input/scene_source.h"
#include "l4d/experimental/copy.h"
#include "l4d/experimental/inspect.h"
#include "l4d/members.h"
#include "libl4dcodec/scene/frame.h"

namespace l4d::cli {

// A member with the numbers of those that it needs.
struct MemberInfo {
  l4d_member member{};
  std::vector<uint32_t> needs;

  bool is_media() const { return member.role == L4D_MEMBER_MEDIA; }
  bool is_index() const { return member.role == L4D_MEMBER_INDEX; }
  Json json() const;
};
const char* member_role_name(uint32_t role);

struct SequenceSpan {
  double begin, end;
};

class MemberFile {
 public:
  // Throws a Failure where the first member is not whole. ignore_index: as l4d_members_options.
  MemberFile(const Context& context, const Input& input, bool ignore_index = false)
      : MemberFile(context, input.path(), input.name(), ignore_index) {}
  // name: messages begin with it.
  MemberFile(const Context& context, const std::string& path, const std::string& name,
             bool ignore_index);

  const std::vector<MemberInfo>& members() const { return members_; }
  const l4d_members_info& info() const { return info_; }
  // Why the list ends before the file, "" if it does not.
  std::string rest() const { return info_.rest_message; }
  const l4d_members* get() const { return list_.get(); }
  l4d_reader reader(size_t index) const;
  // As reader, where a damaged member is no failure.
  l4d_status find_reader(size_t index, l4d_reader* out) const {
    return l4d_members_get_reader(list_.get(), index, out);
  }
  // As the headers of a member say.
  uint64_t num_gaussians(size_t index) const;
  // What a member presents in seconds of its own sequence, as its own headers say.
  SequenceSpan sequence_of(size_t index) const;
  // What all members have in common, as the first one says.
  SceneFrame frame() const;
  // How many members are no index.
  size_t num_streams() const;
  bool is_signed() const { return is_signed_; }
  // One stream that says nothing of members.
  bool is_plain() const;
  bool has_index() const { return members_.back().is_index(); }
  bool has_media() const;
  // From the first span to the last one. Throws a Failure if there is no media member.
  double begin() const;
  double end() const;
  // Throws a Failure if the file does not end with its last member.
  void require_whole() const;

 private:
  MembersHandle open(const l4d_reader& reader, bool ignore_index) const;
  DecoderHandle open_stream(size_t index) const;

  std::string name_;
  uint64_t max_memory_bytes_;
  FileReader reader_;
  MembersHandle list_;
  bool is_signed_ = false;
  l4d_members_info info_{};
  std::vector<MemberInfo> members_;
};

// A file of members in the making, without a name until it is whole.
class MemberWriter {
 public:
  explicit MemberWriter(const Context& context)
      : context_(context), options_(context.decoder_options()), file_(io::anonymous_file()) {}

  // Copies a member. What of it has been written is taken back where that fails. tolerant: pages
  // that are damaged are left out.
  l4d_status add(const l4d_reader& stream, const l4d_member_parameters& parameters,
                 bool tolerant = false);
  // Of the member that was added last.
  uint64_t last_num_gaussians();
  // Decodes the member that was added last and checks all rules of the format. If it breaks one, it
  // is taken back and *why receives the rule.
  bool prove_last(std::string* why);
  // Of all members added.
  void add_index();
  // Copies the file to where an output belongs. Returns its size.
  uint64_t finish(Output& output);

 private:
  static int write(void* user, const void* src, size_t n);
  [[noreturn]] void fail(const char* action, int error) const;
  l4d_writer writer();
  MemberFile written();
  void take_back(uint64_t bytes);

  const Context& context_;
  l4d_decoder_options options_;
  io::FileHandle file_;
  uint64_t bytes_ = 0;
  uint64_t last_begin_ = 0;  // where the member begins that was added last
  size_t count_ = 0;         // of members
  int error_ = 0;            // errno of a write that failed
};

l4d_member_parameters parameters_of(const MemberInfo& member);

// Times of the presentation that differ by this much differ by roundings of sums only.
double rounding_of(const l4d_member& member);

// Notes bytes of a stream of a file that belong to no chunk of it. sections: as
// l4d_decoder_get_sections.
void note_unused(Context& context, const Input& input, uint64_t stream_bytes,
                 const std::vector<uint64_t>& sections);
void note_unused(Context& context, const Input& input, const DecoderHandle& decoder);

// Notes that the signature of a file is not copied, where it has one.
void note_signature(Context& context, const Input& input, const MemberFile& file);

// Whether a file is shown as what its members present: it has several streams, or one that presents
// a part of its sequence, or at other times. Notes what of a file is not shown.
bool has_members(Context& context, const Input& input);

// Notes what a command that reads one stream does not take of a file: other members, and times
// that the stream does not present.
void note_members(Context& context, const Input& input, const l4d_timeline& timeline);
// Of a scene that was read from the first stream of a file: gives it the times at which the stream
// is presented, and notes other members.
void present(Context& context, const Input& input, LoadedScene* loaded);

}  // namespace l4d::cli
