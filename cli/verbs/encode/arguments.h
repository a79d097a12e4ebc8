// SPDX-License-Identifier: Apache-2.0
// What `encode` is asked for.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "cli/input/camera_arguments.h"
#include "cli/input/frame_files.h"
#include "cli/input/scene_source.h"
#include "cli/verbs/encode/live.h"
#include "cli/verbs/encode/parameters.h"
#include "cli/verbs/encode/target.h"
#include "cli/verbs/importance.h"

namespace l4d::cli {

struct EncodeArguments {
  std::vector<std::string> inputs;
  std::string input;                // the first of them
  std::vector<std::string> frames;  // of a sequence, else empty
  SequenceInputArguments sequence;
  std::string output;
  std::string weights;
  CameraArguments cameras;
  MeasureArguments measure;
  std::string save_weights;
  bool no_prune = false;
  bool estimate = false;
  std::string refit;  // "" = where the views are all there are
  std::string order;
  uint64_t seed = 0;
  bool verify = false;
  std::vector<std::string> metadata;
  std::string rendering, presentation;
  bool no_first_view = false;
  EncodeParameters parameters;
  TargetArguments target;
  ImportArguments import;
  LiveArguments live;

  // With weights of a file, cameras say only how small a Gaussian can look, and serve a target.
  bool measures() const;
  // Whether views are made up for a scene that comes without cameras. The pieces of a recording
  // that grows are not waited for, and all have importance of one kind.
  bool may_look_around() const;
  // Whether the views are all that the scene is made for.
  bool has_all_views() const;
  uint32_t weight_views() const;  // L4D_WEIGHT_VIEWS_*
  // Of --live: more than one scene that is there.
  bool has_pieces() const;
};
void add_options(Verb* verb, EncodeArguments& arguments);

// Why opacities are not fitted with these options; "" = they can be.
std::string refit_obstacle(const EncodeArguments& arguments,
                           const std::optional<eval::Target>& target);
// Usage errors that need no file, and the target.
std::optional<eval::Target> check(Context& context, const EncodeArguments& arguments);
void check_live(Context& context, const EncodeArguments& arguments, bool has_target);

}  // namespace l4d::cli
