// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cli/command/context.h"
#include "cli/input/camera_arguments.h"
#include "eval/target/target.h"

namespace l4d::cli {

// What an encode may be asked to reach, in place of a quality.
struct TargetArguments {
  std::string size;
  std::string bitrate;
  std::string fidelity;
  std::string psnr_loss;
  std::string max_error;
  std::string jod, display;

  void add_options(Verb* verb);
};

// "3.00 MB", "42.10 dB of fidelity"
std::string format_figure(const eval::Target& target, double figure);

// Nothing where no target is asked for. Usage errors: more than one, or none that can be.
std::optional<eval::Target> parse_target(const TargetArguments& arguments,
                                         const CameraArguments& cameras);

// How encodings are decoded for the comparison with their scene. min_sizes: those that the encoder
// got, so that errors are measured as a stream states them.
eval::Decoding decoding_of(Context& context, const std::vector<float>& min_sizes);

struct TargetReached {
  eval::Target target;
  eval::QualitySearch search;
  size_t views = 0;  // that fidelity is measured in
  double seconds = 0;

  Json json() const;
  // Where it is not met.
  void note(Context& context) const;
  std::string text() const;
};

// Encodes the encoder's scene over and over, with the quality that reaches the target best at the
// end. scene: the same.
TargetReached encode_to_target(Context& context, const eval::Target& target,
                               const EncoderHandle& encoder, const std::string& name,
                               const io::Scene& scene, const CameraArguments& cameras,
                               const std::vector<float>& min_sizes, eval::Encoding* encoding);

}  // namespace l4d::cli
