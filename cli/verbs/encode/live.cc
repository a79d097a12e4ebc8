// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs/encode/live.h"

#include <memory>
#include <optional>

#include "cli/command/progress.h"
#include "cli/command/values.h"
#include "cli/input/byte_writer.h"
#include "cli/input/playlist.h"
#include "cli/text/units.h"
#include "cli/verbs/encode/live_pieces.h"
#include "cli/verbs/encode/recording.h"
#include "eval/scene/motion.h"
#include "eval/target/encoding.h"
#include "l4d/experimental/session.h"

namespace l4d::cli {
namespace {

constexpr double kSegmentSeconds = 2;

// A session of the encoder that begins with the first piece.
class LiveSession {
 public:
  LiveSession(Context& context, const EncoderHandle& encoder, double segment)
      : encoder_(encoder), memory_(context.budget().take(context.session_memory(), "the session")) {
    options_ = L4D_INIT(l4d_session_options);
    options_.segment_seconds = segment;
    options_.max_memory_bytes = context.session_memory();
  }
  ~LiveSession() { l4d_session_destroy(session_); }
  LiveSession(const LiveSession&) = delete;
  LiveSession& operator=(const LiveSession&) = delete;

  // last: no piece comes after it.
  void add(const io::Scene& scene, bool last, Recording* recording) {
    options_.has_end = last ? 1 : 0;
    options_.end = scene.timeline.time_begin + io::duration(scene.timeline);
    if (session_ == nullptr) {
      encoder_.check(l4d_session_create(encoder_.get(), &options_, &session_));
    }
    encoder_.check(scene.count() > 0
                       ? l4d_session_add(session_)
                       : l4d_session_add_empty(session_, &scene.timeline, &scene.placement));
    for (;;) {
      std::vector<uint8_t> bytes;
      const l4d_writer writer = writer_to(&bytes);
      l4d_member member = L4D_INIT(l4d_member);
      encoder_.check(l4d_session_encode(session_, &writer, &member));
      if (member.bytes == 0) return;
      recording->add(bytes);
    }
  }

 private:
  const EncoderHandle& encoder_;
  std::shared_ptr<void> memory_;
  l4d_session_options options_{};
  l4d_session* session_ = nullptr;
};

// Notes the seconds between pieces that no piece has: one may be lost.
class GapNotes {
 public:
  explicit GapNotes(Context& context) : context_(context) {}

  void add(const std::string& name, const l4d_timeline& timeline) {
    const double begin = timeline.time_begin;
    // Ends that are less than a frame apart are one end; a lost piece has a frame at least.
    const double frame = 0.999 * timeline.fps_den / timeline.fps_num;
    if (end_ && begin > *end_ + frame) {
      context_.note(name + " begins at " + format_time(begin) +
                    " s, and the pieces before it end at " + format_time(*end_) +
                    " s: no piece has the " + format_time(begin - *end_) + " s between them");
    }
    end_ = begin + io::duration(timeline);
  }

 private:
  Context& context_;
  std::optional<double> end_;  // s, of the last piece
};

// What `lossless` does not keep here.
void note_faint(Context& context, const Input& piece, const io::Scene& scene) {
  size_t faint = 0;
  for (size_t i = 0; i < scene.count(); ++i) {
    if (eval::linear_opacity(scene, i) < 1.0 / 255) ++faint;
  }
  if (faint == 0) return;
  context.note(piece.name() + ": " + format_items(faint, "Gaussian") +
               " of an opacity below 1/255 left out, which nothing draws");
}

// Codes pieces as long as they come, and counts them.
void code_pieces(Context& context, LivePieces& pieces, const LiveEncoding& encoding,
                 LiveSession& session, Recording& recording, size_t* count) {
  Progress progress(context, "encode");
  GapNotes gaps(context);
  const bool lossless = encoding.encoder.value(L4D_ENC_LOSSLESS) != 0;
  while (const Input* piece = pieces.next()) {
    const auto code = [&](const io::Scene& scene) {
      encoding.encoder.check(
          l4d_encoder_set_progress(encoding.encoder.get(), &eval::Observer::callback, &progress));
      session.add(scene, pieces.is_one(), &recording);
      gaps.add(piece->name(), scene.timeline);
      if (lossless) note_faint(context, *piece, scene);
    };
    encoding.read(*piece,
                  [&](const io::Scene& scene) { about(piece->name(), [&] { code(scene); }); });
    ++*count;
  }
  if (recording.members().empty()) {
    throw Failure(L4D_ERR_INVALID_SCENE, "the folder ended without a piece");
  }
}

// After an exception: what is there ends as a whole file. Throws what was caught.
[[noreturn]] void end_early(Context& context, Recording& recording, const std::string& output) {
  const Failure why = current_failure("");
  if (recording.members().empty()) throw why;
  std::string left = output + " ends at " + format_time(recording.end()) + " s, with the " +
                     format_items(recording.members().size(), "whole member");
  try {
    recording.finish();
  } catch (...) {
    left += std::string(" and no index: ") + current_failure("").what();
  }
  if (interrupted()) context.note(left);
  // What the encoder calls an argument is the piece.
  const bool is_data = why.name() == l4d_status_name(L4D_ERR_INVALID_ARGUMENT);
  const std::string detail = std::string(why.what()) + "; " + left;
  throw is_data ? Failure(L4D_ERR_INVALID_SCENE, detail) : Failure(why.code(), why.name(), detail);
}

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
  LivePieces pieces(context, inputs, output);
  Recording recording(context, {output, arguments.playlist, arguments.url}, segment);
  LiveSession session(context, encoding.encoder, segment);
  size_t count = 0;
  try {
    code_pieces(context, pieces, encoding, session, recording, &count);
  } catch (...) {
    end_early(context, recording, output);
  }
  recording.finish();
  const size_t media = recording.num_media();
  const size_t standing = recording.members().size() - media;
  const double begin = recording.begin(), end = recording.end();
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
