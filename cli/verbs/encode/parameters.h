// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "cli/command/context.h"

namespace l4d::cli {

// The encoder parameters as options. Every parameter can be had by --set; those people reach for
// have an option of their own. They apply in the order preset, own options, --set.
struct EncodeParameters {
  std::string preset = "default";
  std::string quality;
  std::string effort;
  std::vector<std::string> codebook;
  std::vector<std::string> stages;
  std::string tiers;
  std::vector<std::string> escape_threshold;
  std::string rcq;
  std::string rcq_size;
  std::string prune_weight;
  std::string profile;
  std::string level;
  bool drop_invalid = false;
  std::vector<std::string> set;

  void add_options(Verb* verb);
  // Notes options that change nothing with what else is set.
  void apply(Context& context, const EncoderHandle& encoder) const;
  // Says which of them a stream that was written shows nothing of.
  void note_unused(Context& context, const DecoderHandle& written) const;
  // Whether --set names this parameter.
  bool sets(const std::string& name) const;
  // Usage error of `option` where nothing follows the quality: codebooks and lossless streams.
  void require_quality(const EncoderHandle& encoder, const std::string& option) const;
};

// Presets and parameters, as the library describes them.
std::string parameter_help();

}  // namespace l4d::cli
