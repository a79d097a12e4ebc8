// SPDX-License-Identifier: Apache-2.0
// Files of several streams, as commands read and write them.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "cli/common.h"
#include "cli/files.h"
#include "l4d/members.h"

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

class MemberFile {
 public:
  // Throws a Failure where the first member is not whole. ignore_index: as l4d_members_options.
  MemberFile(const Context& context, const std::string& path, bool ignore_index = false);

  const std::vector<MemberInfo>& members() const { return members_; }
  const l4d_members_info& info() const { return info_; }
  // Why the list ends before the file, "" if it does not.
  std::string rest() const { return l4d_members_rest_message(list_.get()); }
  const l4d_members* get() const { return list_.get(); }
  l4d_reader reader(size_t index) const;
  // One stream that says nothing of members.
  bool is_plain() const;
  bool has_index() const { return members_.back().is_index(); }
  // From the first span to the last one. Throws a Failure if there is no media member.
  double begin() const;
  double end() const;
  // Throws a Failure if the file does not end with its last member.
  void require_whole(const std::string& name) const;

 private:
  struct Destroy {
    void operator()(l4d_members* m) const { l4d_members_destroy(m); }
  };
  FileReader reader_;
  std::unique_ptr<l4d_members, Destroy> list_;
  l4d_members_info info_{};
  std::vector<MemberInfo> members_;
};

// A file of members in the making, without a name until it is whole.
class MemberWriter {
 public:
  explicit MemberWriter(const Context& context)
      : context_(context), options_(context.decoder_options()), file_(io::anonymous_file()) {}

  // Copies a member. What of it has been written is taken back where that fails.
  l4d_status add(const l4d_reader& stream, const l4d_member_parameters& parameters);
  // Of all members added.
  void add_index();
  // Copies the file to where an output belongs. Returns its size.
  uint64_t finish(Output& output);

 private:
  static int write(void* user, const void* src, size_t n);
  l4d_writer writer();

  const Context& context_;
  l4d_decoder_options options_;
  io::FileHandle file_;
  uint64_t bytes_ = 0;
};

l4d_member_parameters parameters_of(const MemberInfo& member);

// Notes what a command that reads one stream does not take of a file: other members, and times
// that the stream does not present.
void note_members(Context& context, const Input& input, const l4d_timeline& timeline);

}  // namespace l4d::cli
