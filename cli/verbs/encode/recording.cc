// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs/encode/recording.h"

#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <memory>

#include "cli/command/progress.h"
#include "cli/input/byte_writer.h"
#include "cli/input/playlist.h"
#include "l4d/experimental/copy.h"

namespace l4d::cli {
namespace {

namespace fs = std::filesystem;

// What a member in memory says of itself. *stream: what it has in common with the others.
MemberInfo describe(const std::vector<uint8_t>& bytes, uint64_t offset, uint64_t* stream) {
  l4d_reader reader = L4D_INIT(l4d_reader);
  reader.user = const_cast<std::vector<uint8_t>*>(&bytes);
  reader.size = [](void* user) {
    return static_cast<int64_t>(static_cast<std::vector<uint8_t>*>(user)->size());
  };
  reader.read_at = [](void* user, void* dst, size_t n, uint64_t at) {
    const auto& from = *static_cast<std::vector<uint8_t>*>(user);
    const size_t begin = static_cast<size_t>(std::min<uint64_t>(at, from.size()));
    const size_t count = std::min(n, from.size() - begin);
    std::memcpy(dst, from.data() + begin, count);
    return static_cast<int64_t>(count);
  };
  const MembersHandle list(reader);
  MemberInfo m{list.member(0), list.needs(0)};
  m.member.offset = offset;
  *stream = list.info().stream;
  return m;
}

// Of the file that is written. FileReader ends with an interrupt, after which this file ends as a
// whole one.
l4d_reader reader_of(io::GrowingFile& file) {
  l4d_reader reader = L4D_INIT(l4d_reader);
  reader.user = &file;
  reader.size = [](void* user) {
    return static_cast<int64_t>(static_cast<io::GrowingFile*>(user)->size());
  };
  reader.read_at = [](void* user, void* dst, size_t n, uint64_t at) {
    const int fd = static_cast<io::GrowingFile*>(user)->descriptor();
    return static_cast<int64_t>(::pread(fd, dst, n, static_cast<off_t>(at)));
  };
  return reader;
}

}  // namespace

Recording::Recording(Context& context, const RecordingNames& names, double segment)
    : segment_(segment), output_(context, names.output) {
  if (output_.is_stdout() || output_.is_special()) {
    throw usage_error("--live needs a file that it can append to");
  }
  if (!names.playlist.empty()) {
    check_extension(names.playlist, "--playlist", {".m3u8"});
    playlist_.emplace(context, names.playlist, "--playlist");
    if (playlist_->is_stdout()) throw usage_error("--playlist cannot go to stdout");
  }
  file_.emplace(output_.path());
  url_ = !names.url.empty() ? names.url
                            : reference_to(names.output, fs::path(names.playlist).parent_path());
  std::error_code error;
  if (!playlist_ || fs::exists(playlist_->path(), error)) return;
  // Players that are there before the first member find it.
  write_playlist(false);
  is_first_playlist_ = true;
}

Recording::~Recording() {
  if (is_first_playlist_ && members_.empty()) ::unlink(playlist_->path().c_str());
}

void Recording::add(const std::vector<uint8_t>& bytes) {
  MemberInfo member = describe(bytes, file_->size(), &stream_);
  file_->append(bytes.data(), bytes.size());
  members_.push_back(std::move(member));
  write_playlist(false);
}

void Recording::finish() {
  const MembersHandle list(reader_of(*file_));
  std::vector<uint8_t> index;
  const l4d_writer writer = writer_to(&index);
  require_ok(l4d_write_member_index(list.get(), &writer, nullptr));
  file_->append(index.data(), index.size());
  write_playlist(true);
}

size_t Recording::num_media() const {
  return static_cast<size_t>(std::count_if(members_.begin(), members_.end(),
                                           [](const MemberInfo& m) { return m.is_media(); }));
}

double Recording::begin() const {
  for (const MemberInfo& m : members_) {
    if (m.is_media()) return m.member.begin;
  }
  return 0;
}

double Recording::end() const {
  for (auto m = members_.rbegin(); m != members_.rend(); ++m) {
    if (m->is_media()) return m->member.end;
  }
  return 0;
}

void Recording::write_playlist(bool complete) {
  if (!playlist_) return;
  const std::string text = playlist_of(members_, complete, url_, stream_, segment_);
  io::OutputFile to(playlist_->path());
  to.write(text.data(), text.size());
  to.commit();
}

}  // namespace l4d::cli
