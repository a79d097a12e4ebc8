// SPDX-License-Identifier: Apache-2.0
// What `encode` says of what it did.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "cli/verbs/encode/arguments.h"
#include "eval/refit/refit.h"
#include "eval/target/encoding.h"

namespace l4d::cli {

// What a command did, and how long that took.
struct Encoded {
  const eval::Encoding& encoding;
  const std::optional<Importance>& importance;
  const std::optional<eval::Refit>& refit;
  const std::optional<TargetReached>& reached;
  double quality, read_seconds, total_seconds;
};
Outcome describe(const EncodeArguments& arguments, const Input& input, const io::Scene& scene,
                 const EncoderHandle& encoder, const std::string& name, const Encoded& encoded);
void add_verification(Context& context, const io::Scene& scene, const std::string& path,
                      const std::vector<float>& min_sizes, const eval::Encoding& encoding,
                      Outcome* outcome);

}  // namespace l4d::cli
