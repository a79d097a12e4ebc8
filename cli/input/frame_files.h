// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "cli/command/context.h"
#include "cli/input/scene_source.h"
#include "io/sequence/sequence.h"

namespace l4d::cli {

// The files of a sequence of frames that inputs name, in their order: more than one file, a folder,
// or a name with one %d in it. Empty if the input is one file. Throws a usage error if a number is
// missing between two that are there.
std::vector<std::string> frame_files(Context& context, const std::vector<std::string>& inputs);

struct SequenceInputArguments {
  std::string match = "auto";
  std::string tolerance;
  bool given() const { return match != "auto" || !tolerance.empty(); }
};
void add_sequence_input_options(Verb* verb, SequenceInputArguments& arguments);

// Reads a sequence of frames as one scene. What became of the frames goes to the notes of the
// context. import: --fps is the rate of frames, or --seconds their duration.
LoadedScene load_frames(Context& context, const std::vector<std::string>& files,
                        const ImportArguments& import, const SequenceInputArguments& arguments);

}  // namespace l4d::cli
