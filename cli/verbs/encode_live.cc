// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs/encode_live.h"

#include <chrono>
#include <cstring>
#include <filesystem>
#include <memory>
#include <optional>
#include <set>
#include <thread>

#include "cli/member_file.h"
#include "cli/playlist.h"
#include "cli/text/progress.h"
#include "cli/text/units.h"
#include "io/file.h"
#include "l4d/session.h"

namespace l4d::cli {
namespace {

namespace fs = std::filesystem;

constexpr double kSegmentSeconds = 2;
constexpr const char* kEnd = "end";  // of a folder: no more pieces come
constexpr std::chrono::milliseconds kLookAgain{50};

// The pieces of a command, in their order.
class Pieces {
 public:
  Pieces(Context& context, const std::vector<std::string>& inputs) : context_(context) {
    std::error_code error;
    if (inputs.size() == 1 && fs::is_directory(inputs.front(), error)) {
      folder_ = inputs.front();
      return;
    }
    for (const std::string& name : inputs) inputs_.emplace_back(context, name);
  }

  bool is_folder() const { return !folder_.empty(); }
  // Whether there is nothing but this scene, so that its end is the end.
  bool is_one() const { return !is_folder() && inputs_.size() == 1; }

  // Waits for the next piece of a folder. Null after the last.
  const Input* next() {
    if (!is_folder()) return next_ < inputs_.size() ? &inputs_[next_++] : nullptr;
    for (;;) {
      check_interrupt();
      // Before the look at the pieces: all of them are there if this is.
      const bool ended = fs::exists(fs::path(folder_) / kEnd);
      const std::string found = first_after();
      if (!found.empty()) {
        last_ = found;
        inputs_.clear();
        inputs_.emplace_back(context_, (fs::path(folder_) / found).string());
        return &inputs_.back();
      }
      if (ended) return nullptr;
      std::this_thread::sleep_for(kLookAgain);
    }
  }

 private:
  // The first name of a piece that sorts behind the last one taken; "" if there is none.
  std::string first_after() const {
    std::string first;
    std::error_code error;
    for (const fs::directory_entry& entry : fs::directory_iterator(folder_, error)) {
      const std::string name = entry.path().filename().string();
      const std::string extension = entry.path().extension().string();
      const bool piece = name.front() != '.' && (extension == ".ply" || extension == ".l4d");
      if (!piece || name <= last_) continue;
      if (first.empty() || name < first) first = name;
    }
    if (error) throw Failure(L4D_ERR_IO, folder_ + ": cannot read: " + error.message());
    return first;
  }

  Context& context_;
  std::string folder_;
  std::deque<Input> inputs_;
  size_t next_ = 0;
  std::string last_;
};

// What a member in memory says of itself.
MemberInfo describe(const std::vector<uint8_t>& bytes, uint64_t offset) {
  l4d_reader reader;
  l4d_reader_init(&reader);
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
  l4d_members* list = nullptr;
  const auto check = [](l4d_status status) {
    if (status != L4D_OK) throw Failure(status, l4d_last_error_message());
  };
  check(l4d_members_open(&reader, nullptr, &list));
  const std::unique_ptr<l4d_members, void (*)(l4d_members*)> owner(list, &l4d_members_destroy);
  MemberInfo m;
  l4d_member_init(&m.member);
  check(l4d_members_get(list, 0, &m.member));
  m.needs.resize(m.member.num_needs);
  uint64_t count = 0;
  check(l4d_members_get_needs(list, 0, m.needs.data(), m.needs.size(), &count));
  m.member.offset = offset;
  return m;
}

int append(void* user, const void* src, size_t n) {
  const auto* bytes = static_cast<const uint8_t*>(src);
  auto& to = *static_cast<std::vector<uint8_t>*>(user);
  to.insert(to.end(), bytes, bytes + n);
  return 0;
}

// A file that grows member by member, and its playlist.
class Recording {
 public:
  Recording(Context& context, const LiveArguments& arguments, const std::string& name,
            double segment)
      : context_(context), arguments_(arguments), output_(context, name), segment_(segment) {
    if (output_.is_stdout() || output_.is_special()) {
      throw usage_error("--live needs a file that it can append to");
    }
    if (!arguments.playlist.empty()) {
      check_extension(arguments.playlist, "--playlist", {".m3u8"});
      playlist_.emplace(context, arguments.playlist, "--playlist");
      if (playlist_->is_stdout()) throw usage_error("--playlist cannot go to stdout");
    }
    file_.emplace(output_.path());
    url_ = arguments.url.empty() ? reference_to(name, fs::path(arguments.playlist).parent_path())
                                 : arguments.url;
    write_playlist(false);
  }

  void add(const std::vector<uint8_t>& bytes) {
    members_.push_back(describe(bytes, bytes_));
    file_->append(bytes.data(), bytes.size());
    bytes_ += bytes.size();
    write_playlist(false);
  }
  // Writes the index.
  void finish() {
    const MemberFile made(context_, output_.path(), output_.path(), true);
    std::vector<uint8_t> index;
    l4d_writer writer;
    l4d_writer_init(&writer);
    writer.user = &index;
    writer.write = &append;
    const l4d_status status = l4d_write_member_index(made.get(), &writer, nullptr);
    if (status != L4D_OK) throw Failure(status, l4d_last_error_message());
    file_->append(index.data(), index.size());
    bytes_ += index.size();
    write_playlist(true);
  }

  const std::vector<MemberInfo>& members() const { return members_; }
  uint64_t bytes() const { return bytes_; }

 private:
  void write_playlist(bool complete) {
    if (!playlist_) return;
    const std::string text = playlist_of(members_, complete, url_, 1.5 * segment_);
    io::OutputFile to(playlist_->path());
    to.write(text.data(), text.size());
    to.commit();
  }

  Context& context_;
  const LiveArguments& arguments_;
  Output output_;
  double segment_;
  std::optional<Output> playlist_;
  std::optional<io::GrowingFile> file_;
  std::string url_;
  std::vector<MemberInfo> members_;
  uint64_t bytes_ = 0;
};

// A session of the encoder that begins with the first piece.
class LiveSession {
 public:
  LiveSession(const EncoderHandle& encoder, double segment) : encoder_(encoder) {
    l4d_session_options_init(&options_);
    options_.segment_seconds = segment;
  }
  ~LiveSession() { l4d_session_destroy(session_); }
  LiveSession(const LiveSession&) = delete;
  LiveSession& operator=(const LiveSession&) = delete;

  // last: no piece comes after it.
  void add(const io::Scene& scene, bool last, Recording* recording) {
    if (last) options_.end = scene.timeline.time_begin + io::duration(scene.timeline);
    if (session_ == nullptr) {
      encoder_.check(l4d_session_create(encoder_.get(), &options_, &session_));
    }
    encoder_.check(l4d_session_add(session_));
    for (;;) {
      std::vector<uint8_t> bytes;
      l4d_writer writer;
      l4d_writer_init(&writer);
      writer.user = &bytes;
      writer.write = &append;
      l4d_member member;
      l4d_member_init(&member);
      encoder_.check(l4d_session_encode(session_, &writer, &member));
      if (member.bytes == 0) return;
      recording->add(bytes);
    }
  }

 private:
  const EncoderHandle& encoder_;
  l4d_session_options options_{};
  l4d_session* session_ = nullptr;
};

}  // namespace

void LiveArguments::check() const {
  if (!live && !(segment.empty() && playlist.empty() && url.empty())) {
    throw usage_error("--segment, --playlist and --url need --live");
  }
  if (!url.empty() && playlist.empty()) throw usage_error("--url needs --playlist");
  check_url(url);
}

void add_live_options(Verb* verb, LiveArguments& arguments) {
  verb->add_flag("--live", arguments.live,
                 "Write a file of several streams, which plays while it grows. The input is a "
                 "scene, or pieces of one in their order, or a folder in which pieces appear (by "
                 "renaming, in the order of their names) until a file named `end` does");
  verb->add_option("--segment", arguments.segment,
                   "With --live: seconds of each media member; 2 if left out")
      ->type_name("SECONDS");
  verb->add_option("--playlist", arguments.playlist,
                   "With --live: HLS playlist to write, and to replace with each member")
      ->type_name("FILE");
  verb->add_option("--url", arguments.url,
                   "Of --playlist: where players find the file; its path from the playlist if "
                   "left out")
      ->type_name("URL");
}

Outcome encode_live(Context& context, const LiveArguments& arguments,
                    const std::vector<std::string>& inputs, const std::string& output,
                    const LiveEncoding& encoding) {
  const Stopwatch watch;
  const double segment =
      arguments.segment.empty() ? kSegmentSeconds : parse_seconds(arguments.segment, "--segment");
  if (!(segment > 0)) throw usage_error("--segment must be above 0");
  Pieces pieces(context, inputs);
  Recording recording(context, arguments, output, segment);
  LiveSession session(encoding.encoder, segment);
  Progress progress(context, "encode");
  size_t count = 0;
  while (const Input* piece = pieces.next()) {
    encoding.read(*piece, [&](const io::Scene& scene) {
      about(piece->name(), [&] {
        encoding.encoder.check(
            l4d_encoder_set_progress(encoding.encoder.get(), &eval::Observer::callback, &progress));
        session.add(scene, pieces.is_one(), &recording);
      });
    });
    ++count;
  }
  if (recording.members().empty()) {
    throw Failure(L4D_ERR_INVALID_SCENE, "the folder ended without a piece");
  }
  recording.finish();
  size_t media = 0, standing = 0;
  double begin = 0, end = 0;
  for (const MemberInfo& m : recording.members()) {
    if (!m.is_media()) {
      ++standing;
      continue;
    }
    if (media++ == 0) begin = m.member.begin;
    end = m.member.end;
  }
  Outcome outcome;
  outcome.json = {{"schema", "l4dcodec.live/1"},
                  {"inputs", inputs},
                  {"output", output},
                  {"num_pieces", count},
                  {"num_media", media},
                  {"num_standing", standing},
                  {"begin", begin},
                  {"end", end},
                  {"file_bytes", recording.bytes()},
                  {"total_s", watch.seconds()}};
  outcome.text =
      format("%s: %zu media and %zu standing members, %s to %s s, %s, in %s\n", output.c_str(),
             media, standing, format_time(begin).c_str(), format_time(end).c_str(),
             format_bytes(recording.bytes()).c_str(), format_seconds(watch.seconds()).c_str());
  return outcome;
}

}  // namespace l4d::cli
