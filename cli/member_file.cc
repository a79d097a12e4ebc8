// SPDX-License-Identifier: Apache-2.0
#include "cli/member_file.h"

#include <algorithm>

#include "cli/text/progress.h"
#include "cli/text/units.h"
#include "io/file.h"

namespace l4d::cli {

const char* member_role_name(uint32_t role) {
  switch (role) {
    case L4D_MEMBER_MEDIA:
      return "media";
    case L4D_MEMBER_STANDING:
      return "standing";
    case L4D_MEMBER_INDEX:
      return "index";
    default:
      return "unknown";
  }
}

Json MemberInfo::json() const {
  return {{"number", member.number}, {"role", member_role_name(member.role)},
          {"offset", member.offset}, {"bytes", member.bytes},
          {"begin", member.begin},   {"end", member.end},
          {"shift", member.shift},   {"needs", needs}};
}

MemberFile::MemberFile(const Context& context, const std::string& path, bool ignore_index)
    : reader_(path) {
  l4d_members_options options;
  l4d_members_options_init(&options);
  options.max_memory_bytes = context.decoder_options().max_memory_bytes;
  options.ignore_index = ignore_index ? 1 : 0;
  l4d_members* list = nullptr;
  const auto check = [](l4d_status status) {
    if (status != L4D_OK) throw Failure(status, l4d_last_error_message());
  };
  check(l4d_members_open(reader_.get(), &options, &list));
  list_.reset(list);
  l4d_members_info_init(&info_);
  check(l4d_members_get_info(list, &info_));
  for (uint64_t i = 0; i < info_.count; ++i) {
    MemberInfo m;
    l4d_member_init(&m.member);
    check(l4d_members_get(list, i, &m.member));
    m.needs.resize(m.member.num_needs);
    uint64_t count = 0;
    check(l4d_members_get_needs(list, i, m.needs.data(), m.needs.size(), &count));
    members_.push_back(std::move(m));
  }
}

l4d_reader MemberFile::reader(size_t index) const {
  l4d_reader out;
  l4d_reader_init(&out);
  const l4d_status status = l4d_members_get_reader(list_.get(), index, &out);
  if (status != L4D_OK) throw Failure(status, l4d_last_error_message());
  return out;
}

bool MemberFile::is_plain() const {
  const MemberInfo& first = members_.front();
  return members_.size() == 1 && info_.rest == L4D_OK && first.is_media() && first.needs.empty() &&
         first.member.shift == 0 && first.member.number == 0;
}

double MemberFile::begin() const {
  for (const MemberInfo& m : members_) {
    if (m.is_media()) return m.member.begin;
  }
  throw Failure(L4D_ERR_CORRUPT, "no media member");
}

double MemberFile::end() const {
  for (auto m = members_.rbegin(); m != members_.rend(); ++m) {
    if (m->is_media()) return m->member.end;
  }
  throw Failure(L4D_ERR_CORRUPT, "no media member");
}

void MemberFile::require_whole(const std::string& name) const {
  if (info_.rest == L4D_OK) return;
  throw Failure(info_.rest, name + ": " + rest() + "; `l4dcodec repair` keeps the members before");
}

l4d_member_parameters parameters_of(const MemberInfo& m) {
  l4d_member_parameters p;
  l4d_member_parameters_init(&p);
  p.is_member = 1;
  p.number = m.member.number;
  p.role = m.member.role;
  p.shift = m.member.shift;
  p.needs = m.needs.data();
  p.num_needs = static_cast<uint32_t>(m.needs.size());
  return p;
}

void note_members(Context& context, const Input& input, const l4d_timeline& timeline) {
  std::unique_ptr<MemberFile> opened;
  try {
    opened = std::make_unique<MemberFile>(context, input.path());
  } catch (const Failure&) {
    return;  // a damaged file, which the command may still read in part
  }
  const MemberFile& file = *opened;
  const auto number =
      static_cast<size_t>(std::count_if(file.members().begin(), file.members().end(),
                                        [](const MemberInfo& m) { return !m.is_index(); }));
  if (number > 1) {
    context.note(input.name() + " has " + std::to_string(number) +
                 " streams, of which the first one is taken; `l4dcodec cut --member` takes others");
  }
  const l4d_member& first = file.members().front().member;
  const double end = timeline.time_begin + io::duration(timeline);
  const double shown = first.begin - first.shift, shown_end = first.end - first.shift;
  const double rounding = 1e-9 * io::duration(timeline);
  if (shown <= timeline.time_begin + rounding && shown_end >= end - rounding) return;
  context.note(input.name() + " presents " + format_time(shown) + " to " + format_time(shown_end) +
               " s of its sequence; it may lack what is seen at other times");
}

int MemberWriter::write(void* user, const void* src, size_t n) {
  auto& self = *static_cast<MemberWriter*>(user);
  if (std::fwrite(src, 1, n, self.file_.get()) != n) return -1;
  self.bytes_ += n;
  return 0;
}

l4d_writer MemberWriter::writer() {
  l4d_writer out;
  l4d_writer_init(&out);
  out.user = this;
  out.write = &write;
  return out;
}

l4d_status MemberWriter::add(const l4d_reader& stream, const l4d_member_parameters& parameters) {
  const uint64_t before = bytes_;
  const l4d_writer to = writer();
  const l4d_status status = l4d_copy_member(&stream, &options_, &parameters, &to, nullptr);
  check_interrupt();
  if (status == L4D_OK || bytes_ == before) return status;
  // What follows overwrites it, and finish() copies no more than bytes_.
  bytes_ = before;
  if (std::fseek(file_.get(), static_cast<long>(before), SEEK_SET) != 0) return L4D_ERR_IO;
  return status;
}

void MemberWriter::add_index() {
  if (std::fflush(file_.get()) != 0) throw Failure(L4D_ERR_IO, "cannot write a temporary file");
  const MemberFile made(context_, path_of(file_), true);
  const l4d_writer to = writer();
  const l4d_status status = l4d_write_member_index(made.get(), &to, nullptr);
  if (status != L4D_OK) throw Failure(status, l4d_last_error_message());
}

uint64_t MemberWriter::finish(Output& output) {
  constexpr size_t kBlock = size_t{1} << 20;
  std::vector<char> block(kBlock);
  io::OutputFile file(output.path());
  if (std::fseek(file_.get(), 0, SEEK_SET) != 0) {
    throw Failure(L4D_ERR_IO, "cannot read a temporary file");
  }
  for (uint64_t left = bytes_; left > 0;) {
    const size_t n = static_cast<size_t>(std::min<uint64_t>(left, kBlock));
    if (std::fread(block.data(), 1, n, file_.get()) != n) {
      throw Failure(L4D_ERR_IO, "cannot read a temporary file");
    }
    file.write(block.data(), n);
    left -= n;
  }
  file.commit();
  return output.finish();
}

}  // namespace l4d::cli
