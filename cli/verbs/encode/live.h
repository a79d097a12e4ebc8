// SPDX-License-Identifier: Apache-2.0
// encode --live: a scene, or pieces of one as they arrive, as the members of a file that grows.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "cli/command/context.h"
#include "cli/input/files.h"
#include "cli/input/scene_source.h"

namespace l4d::cli {

struct LiveArguments {
  bool live = false;
  std::string segment;
  std::string playlist;
  std::string url;

  // Usage errors, also where --live is not given.
  void check() const;
};
void add_live_options(Verb* verb, LiveArguments& arguments);

// The options of `encode` that say how to code.
struct LiveEncoding {
  const EncoderHandle& encoder;
  // Reads a piece and gives it to the encoder, with its weights; `use` may then encode.
  std::function<void(const Input& piece, const std::function<void(const io::Scene&)>& use)> read;
};

// inputs: a scene, pieces in their order, or a folder in which they appear.
Outcome encode_live(Context& context, const LiveArguments& arguments,
                    const std::vector<std::string>& inputs, const std::string& output,
                    const LiveEncoding& encoding);

}  // namespace l4d::cli
