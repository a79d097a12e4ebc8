// SPDX-License-Identifier: Apache-2.0
#include "cli/input/member_file.h"

#include <algorithm>
#include <cerrno>
#include <cfloat>
#include <cmath>
#include <cstring>

#include "cli/command/progress.h"
#include "cli/text/units.h"
#include "eval/scene/decoded_scene.h"
#include "io/file/file.h"
#include "l4d/experimental/copy.h"
#include "l4d/experimental/inspect.h"

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
  // An index presents nothing.
  const auto time = [&](double seconds) { return is_index() ? Json() : Json(seconds + 0.0); };
  return {{"number", member.number},     {"role", member_role_name(member.role)},
          {"offset", member.offset},     {"bytes", member.bytes},
          {"begin", time(member.begin)}, {"end", time(member.end)},
          {"shift", member.shift + 0.0}, {"needs", needs}};
}

namespace {

// Section 22.1 of the specification.
constexpr char kSignatureMagic[] = {'L', '4', 'D', 'S'};
constexpr uint64_t kSignatureBytes = 100;

bool has_signature(const l4d_reader& reader) {
  const int64_t size = reader.size(reader.user);
  char magic[sizeof kSignatureMagic];
  return size > static_cast<int64_t>(kSignatureBytes) &&
         reader.read_at(reader.user, magic, sizeof magic,
                        static_cast<uint64_t>(size) - kSignatureBytes) == sizeof magic &&
         std::equal(std::begin(magic), std::end(magic), kSignatureMagic);
}

}  // namespace

MembersHandle MemberFile::open(const l4d_reader& reader, bool ignore_index) const {
  l4d_members_options options = L4D_INIT(l4d_members_options);
  options.max_memory_bytes = max_memory_bytes_;
  options.ignore_index = ignore_index ? 1 : 0;
  return about(name_, [&] { return MembersHandle(reader, &options); });
}

MemberFile::MemberFile(const Context& context, const std::string& path, const std::string& name,
                       bool ignore_index)
    : name_(name),
      max_memory_bytes_(context.decoder_options().max_memory_bytes),
      reader_(path),
      list_(open(*reader_.get(), ignore_index)),
      is_signed_(has_signature(*reader_.get())) {
  info_ = list_.info();
  for (uint64_t i = 0; i < info_.count; ++i) {
    members_.push_back({list_.member(i), list_.needs(i)});
  }
}

l4d_reader MemberFile::reader(size_t index) const {
  return about(name_, [&] { return list_.reader(index); });
}

SequenceSpan MemberFile::sequence_of(size_t index) const {
  const l4d_member m = open(reader(index), true).member(0);
  return {m.sequence_begin, m.sequence_end};
}

DecoderHandle MemberFile::open_stream(size_t index) const {
  l4d_decoder_options options = L4D_INIT(l4d_decoder_options);
  options.max_memory_bytes = max_memory_bytes_;
  options.accept_needs = 1;
  DecoderHandle decoder(&options);
  about(name_, [&] { decoder.open(reader(index)); });
  return decoder;
}

uint64_t MemberFile::num_gaussians(size_t index) const {
  return open_stream(index).info().num_gaussians;
}

SceneFrame MemberFile::frame() const {
  const DecoderHandle decoder = open_stream(0);
  return SceneFrame{decoder.info().placement, decoder.rendering()};
}

size_t MemberFile::num_streams() const {
  return static_cast<size_t>(std::count_if(members_.begin(), members_.end(),
                                           [](const MemberInfo& m) { return !m.is_index(); }));
}

bool MemberFile::is_plain() const {
  const MemberInfo& first = members_.front();
  return members_.size() == 1 && info_.rest == L4D_OK && first.is_media() && first.needs.empty() &&
         first.member.shift == 0 && first.member.number == 0;
}

bool MemberFile::has_media() const {
  return std::any_of(members_.begin(), members_.end(),
                     [](const MemberInfo& m) { return m.is_media(); });
}

double MemberFile::begin() const {
  for (const MemberInfo& m : members_) {
    if (m.is_media()) return m.member.begin;
  }
  throw usage_error(name_ +
                    " has no media member: it is valid, but nothing of it belongs to a time");
}

double MemberFile::end() const {
  for (auto m = members_.rbegin(); m != members_.rend(); ++m) {
    if (m->is_media()) return m->member.end;
  }
  throw usage_error(name_ +
                    " has no media member: it is valid, but nothing of it belongs to a time");
}

void MemberFile::require_whole() const {
  if (info_.rest == L4D_OK) return;
  throw Failure(info_.rest, name_ + ": " + rest() + "; `l4dcodec repair` keeps the members before");
}

l4d_member_parameters parameters_of(const MemberInfo& m) {
  l4d_member_parameters p = L4D_INIT(l4d_member_parameters);
  p.is_member = 1;
  p.number = m.member.number;
  p.role = m.member.role;
  p.shift = m.member.shift;
  p.needs = m.needs.data();
  p.num_needs = static_cast<uint32_t>(m.needs.size());
  return p;
}

double rounding_of(const l4d_member& m) {
  const double largest = std::max({std::fabs(m.begin), std::fabs(m.end), std::fabs(m.shift)});
  return 64 * DBL_EPSILON * largest;
}

void note_unused(Context& context, const Input& input, uint64_t stream_bytes,
                 const std::vector<uint64_t>& sections) {
  const FileReader reader(input.path());
  uint64_t used = has_signature(*reader.get()) ? kSignatureBytes : 0;
  for (const uint64_t bytes : sections) used += bytes;
  if (stream_bytes <= used) return;
  context.note(input.name() + ": " + format_count(stream_bytes - used) +
               " bytes belong to no chunk of the stream. A stream that does not say where it ends "
               "has all bytes behind it: no other follows it (`l4dcodec concat` chains streams)");
}

void note_unused(Context& context, const Input& input, const DecoderHandle& decoder) {
  std::vector<uint64_t> sections(L4D_SECTION_COUNT);
  decoder.check(l4d_decoder_get_sections(decoder.get(), sections.data(), L4D_SECTION_COUNT, nullptr,
                                         nullptr, 0));
  note_unused(context, input, decoder.info().file_bytes, sections);
}

void note_signature(Context& context, const Input& input, const MemberFile& file) {
  if (!file.is_signed()) return;
  context.note("the signature of " + input.name() + " is of its bytes, and is not copied");
}

namespace {

// The file as members, null where it is damaged: a command may still read it in part.
std::unique_ptr<MemberFile> open_members(const Context& context, const Input& input) {
  try {
    return std::make_unique<MemberFile>(context, input);
  } catch (const Failure&) {
    return nullptr;
  }
}

void note_others(Context& context, const Input& input, const MemberFile& file) {
  if (file.num_streams() < 2) return;
  context.note(input.name() + " has " + std::to_string(file.num_streams()) +
               " streams, of which the first one is taken; `l4dcodec cut --member` takes others");
}

// Whether a stream presents all of its sequence.
bool presents_all(const l4d_member& m, const l4d_timeline& t) {
  const double rounding = 1e-9 * io::duration(t);
  return m.sequence_begin <= t.time_begin + rounding &&
         m.sequence_end >= t.time_begin + io::duration(t) - rounding;
}

}  // namespace

bool has_members(Context& context, const Input& input) {
  const std::unique_ptr<MemberFile> file = open_members(context, input);
  if (!file) return false;
  if (!file->rest().empty()) {
    context.note(input.name() + ": the list of streams ends before the file: " + file->rest());
  }
  const std::vector<MemberInfo>& members = file->members();
  if (std::none_of(members.begin(), members.end(), [](const auto& m) { return m.is_media(); })) {
    context.note(input.name() + " has no media member that is whole; what is shown is member " +
                 std::to_string(members.front().member.number) +
                 ", which others need, at the times of its own sequence");
    return false;
  }
  if (file->num_streams() > 1) return true;
  const MemberInfo& only = members.front();
  if (!only.needs.empty()) return false;  // which are not here
  if (only.member.shift != 0) return true;
  try {
    const l4d_decoder_options options = context.decoder_options();
    DecoderHandle decoder(&options);
    decoder.open(file->reader(0));
    return !presents_all(only.member, decoder.info().timeline);
  } catch (const Error&) {
    return false;
  }
}

void note_members(Context& context, const Input& input, const l4d_timeline& timeline) {
  const std::unique_ptr<MemberFile> file = open_members(context, input);
  if (!file) return;
  note_others(context, input, *file);
  const l4d_member& first = file->members().front().member;
  if (!presents_all(first, timeline)) {
    context.note(input.name() + " presents " + format_time(first.sequence_begin) + " to " +
                 format_time(first.sequence_end) +
                 " s of its sequence; it may lack what is seen at other times");
  }
  if (first.shift != 0) {
    context.note(input.name() + " presents its sequence " + format_time(std::fabs(first.shift)) +
                 (first.shift > 0 ? " s later" : " s earlier") +
                 "; times here are those of the sequence");
  }
}

void present(Context& context, const Input& input, LoadedScene* loaded) {
  const std::unique_ptr<MemberFile> file = open_members(context, input);
  if (!file) return;
  note_others(context, input, *file);
  const l4d_member& first = file->members().front().member;
  const bool all = presents_all(first, loaded->scene.timeline);
  if (all && first.shift == 0) return;
  const io::Scene& scene = loaded->scene;
  const double begin = all ? scene.timeline.time_begin : first.sequence_begin;
  const double end = all ? begin + io::duration(scene.timeline) : first.sequence_end;
  eval::present(begin, end, first.shift, loaded);
}

int MemberWriter::write(void* user, const void* src, size_t n) {
  auto& self = *static_cast<MemberWriter*>(user);
  if (std::fwrite(src, 1, n, self.file_.get()) != n) {
    self.error_ = errno;
    return -1;
  }
  self.bytes_ += n;
  return 0;
}

void MemberWriter::fail(const char* action, int error) const {
  throw Failure(L4D_ERR_IO,
                std::string("cannot ") + action + " a temporary file: " + std::strerror(error));
}

l4d_writer MemberWriter::writer() {
  l4d_writer out = L4D_INIT(l4d_writer);
  out.user = this;
  out.write = &write;
  return out;
}

l4d_status MemberWriter::add(const l4d_reader& stream, const l4d_member_parameters& parameters,
                             bool tolerant) {
  const uint64_t before = bytes_;
  const l4d_writer to = writer();
  l4d_decoder_options options = options_;
  options.tolerant = tolerant ? 1 : 0;
  const l4d_status status = l4d_copy_member(&stream, &options, &parameters, &to, nullptr);
  check_interrupt();
  if (error_ != 0) fail("write", error_);
  if (status == L4D_OK) {
    last_begin_ = before;
    ++count_;
  } else {
    take_back(before);
  }
  return status;
}

// What follows overwrites what lies behind, and finish() copies no more than bytes_.
void MemberWriter::take_back(uint64_t bytes) {
  if (bytes == bytes_) return;
  bytes_ = bytes;
  if (std::fseek(file_.get(), static_cast<long>(bytes), SEEK_SET) != 0) fail("write", errno);
}

bool MemberWriter::prove_last(std::string* why) {
  const MemberFile made = written();
  const l4d_reader stream = made.reader(count_ - 1);
  l4d_decoder_options options = options_;
  options.accept_needs = 1;
  const auto keep_first = [](void* user, const l4d_violation* v) {
    auto& first = *static_cast<std::string*>(user);
    if (first.empty()) first = std::string(v->clause) + ": " + v->message;
  };
  uint64_t violations = 0;
  const l4d_status status = l4d_validate(&stream, &options, keep_first, why, &violations);
  check_interrupt();
  if (status == L4D_OK && violations == 0) return true;
  if (why->empty()) *why = l4d_last_error_message();
  take_back(last_begin_);
  --count_;
  return false;
}

MemberFile MemberWriter::written() {
  if (std::fflush(file_.get()) != 0) fail("write", errno);
  return MemberFile(context_, path_of(file_), "what was made", true);
}

uint64_t MemberWriter::last_num_gaussians() { return written().num_gaussians(count_ - 1); }

void MemberWriter::add_index() {
  const MemberFile made = written();
  // Readers would not see what lies behind the first member that breaks a rule. What was taken back
  // may still lie behind the last one.
  if (made.info().bytes != bytes_) {
    throw Failure(L4D_ERR_CORRUPT, "the members do not make a file: " + made.rest());
  }
  const l4d_writer to = writer();
  const l4d_status status = l4d_write_member_index(made.get(), &to, nullptr);
  if (error_ != 0) fail("write", error_);
  if (status != L4D_OK) throw Failure(status, l4d_last_error_message());
}

uint64_t MemberWriter::finish(Output& output) {
  constexpr size_t kBlock = size_t{1} << 20;
  std::vector<char> block(kBlock);
  io::OutputFile file(output.path());
  if (std::fseek(file_.get(), 0, SEEK_SET) != 0) fail("write", errno);
  for (uint64_t left = bytes_; left > 0;) {
    const size_t n = static_cast<size_t>(std::min<uint64_t>(left, kBlock));
    if (std::fread(block.data(), 1, n, file_.get()) != n) fail("read", errno);
    file.write(block.data(), n);
    left -= n;
  }
  file.commit();
  output.finish();
  return bytes_;  // a pipe or a device has no size
}

}  // namespace l4d::cli
