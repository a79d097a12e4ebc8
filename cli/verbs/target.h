// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cli/camera_arguments.h"
#include "cli/common.h"
#include "cli/quality_search.h"
#include "cli/verbs/encoding.h"

namespace l4d::cli {

// What an encode may be asked to reach, in place of a quality.
struct TargetArguments {
  std::string size;
  std::string bitrate;
  std::string fidelity;
  std::string psnr_loss;
  std::string max_error;

  void add_options(Verb* verb);
};

struct Target {
  enum class Kind { kSize, kBitrate, kFidelity, kPsnrLoss, kMaxError };
  Kind kind = Kind::kSize;
  double asked = 0;       // bytes, bytes per second, dB, dB, unit of the attribute
  std::string attribute;  // of a largest error

  bool needs_views() const { return kind == Kind::kFidelity || kind == Kind::kPsnrLoss; }
  std::string format_figure(double figure) const;
};

// Nothing where no target is asked for. Usage errors: more than one, or none that can be.
std::optional<Target> parse_target(const TargetArguments& arguments,
                                   const CameraArguments& cameras);

struct TargetResult {
  Target target;
  QualitySearch search;
  size_t views = 0;  // that fidelity is measured in
  double seconds = 0;

  Json json() const;
  std::string text() const;
};

// Encodes the encoder's scene over and over, with the quality that reaches the target best at the
// end. scene: the same.
TargetResult encode_to_target(Context& context, const Target& target, const EncoderHandle& encoder,
                              const std::string& name, const io::Scene& scene,
                              const CameraArguments& cameras, Encoding* encoding);

}  // namespace l4d::cli
