// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "cli/command/context.h"
#include "cli/input/files.h"
#include "eval/scene/decoded_scene.h"

namespace l4d::cli {

// Options of verbs that may read a PLY which has no timeline.
struct ImportArguments {
  std::string seconds;
  std::string fps;
  bool activated = false;
  bool may_be_empty = false;  // without Gaussians: a piece in which nothing becomes known
  const std::string* cameras = nullptr;  // the text of --cameras, whose times --seconds then scales
  // Usage errors, also where the scene is a stream and neither is used.
  void check() const;
};
// cameras: that of the arguments, of a verb that has --cameras.
void add_import_options(Verb* verb, ImportArguments& arguments,
                        const std::string* cameras = nullptr);
// A note for each of them that was given and that the input, which is a stream, has no use for.
void note_unused(Context& context, const Input& input, const ImportArguments& arguments,
                 const l4d_timeline& timeline);

using LoadedScene = eval::DecodedScene;

// Reads a whole scene from a PLY of any known kind or from a stream. Import notes go to the
// context.
LoadedScene load_scene(Context& context, const Input& input, const ImportArguments& arguments = {});

// Gives an encoder a scene with what it states of itself; borrowed.
void set_scene(const io::Scene& scene, const EncoderHandle& encoder);

// A stream of the scene for one command, which stays in memory. verb: of its progress.
std::vector<unsigned char> lossless_stream(Context& context, const io::Scene& scene,
                                           const char* verb);

// Reads all of an open stream, or what `query` selects; counted as held memory.
LoadedScene decode_scene(Context& context, const DecoderHandle& decoder,
                         const l4d_query* query = nullptr);

// A decoder with any scene open in it: verbs that look into streams so take a PLY too, which is
// encoded losslessly in memory.
class SceneStream {
 public:
  SceneStream(Context& context, const Input& input, const ImportArguments& arguments = {});
  const DecoderHandle& decoder() const { return decoder_; }
  const l4d_info& info() const { return info_; }
  // Where the scene came from: "l4d", or the kind of PLY.
  const std::string& source() const { return source_; }

 private:
  std::vector<unsigned char> stream_;  // of a PLY; the decoder borrows it
  DecoderHandle decoder_;
  l4d_info info_{};
  std::string source_;
};

double frames_per_second(const l4d_timeline& timeline);
// "5 s, 150 frames at 30 fps"
std::string describe_timeline(const l4d_timeline& timeline);
Json timeline_json(const l4d_timeline& timeline);

// `seconds` limited to the sequence, as the library does it, with a note where that changes it.
double clamp_to_sequence(Context& context, const l4d_timeline& timeline, double seconds,
                         const char* option);

}  // namespace l4d::cli
