// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "cli/common.h"

namespace l4d::cli {

// The encoder parameters as options. Every parameter can be had by --set; those people reach for
// have an option of their own. They apply in the order preset, own options, --set.
struct EncodeParameters {
  std::string preset = "default";
  std::string effort;
  std::vector<std::string> codebook;
  std::vector<std::string> stages;
  std::vector<std::string> literal_threshold;
  std::string rcq;
  std::string rcq_size;
  std::string prune_weight;
  bool drop_invalid = false;
  std::vector<std::string> set;

  void add_options(CLI::App* verb);
  void apply(const EncoderHandle& encoder) const;
};

// Presets and parameters, as the library describes them.
std::string parameter_help();

}  // namespace l4d::cli
