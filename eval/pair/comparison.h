// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "eval/pair/pair_meter.h"
#include "eval/pair/pairing.h"

namespace l4d::eval {

struct AttributeError {
  const char* name;
  const char* meaning;  // how it is measured; for people
  double max = 0;
  double rmse = 0;
};

// Distance between where A's Gaussian is and where B puts it, while A's is visible.
struct VisibleError {
  uint32_t layer = 0;
  uint32_t level = 0;
  uint64_t gaussians = 0;  // matched and visible at some time
  double max = 0;
  double p999 = 0;
  double rmse = 0;
};

// An error on the scale of each Gaussian, and which Gaussian of A has the largest.
struct SeenError {
  const char* name;
  const char* meaning;
  double max = 0;
  double p999 = 0;
  uint32_t worst = 0;
};

struct Comparison {
  uint64_t count_a = 0;
  uint64_t count_b = 0;
  Pairing pairing;
  std::vector<AttributeError> attributes;
  VisibleError visible;
  std::vector<VisibleError> layers;  // of B, where it is a stream
  double min_size = 0;               // scene units: smaller sizes count as this
  std::vector<SeenError> seen;

  // Same Gaussians bit for bit, in any order.
  bool identical() const { return pairing.equal_rows == count_a && count_a == count_b; }
  // Largest error that one of error_names() names.
  double max_error(const std::string& name) const;
};

// visible_position, the attributes, and the errors of `seen`.
std::vector<std::string> error_names();

// a: the reference. pairing: of b's Gaussians with a's; errors of single Gaussians are left out
// where it is not known. threads: 0 = one per core; the figures are the same for any number.
// min_sizes, stream_a: as PairMeter takes them.
Comparison compare_scenes(const io::Scene& a, const DecodedScene& b, Pairing pairing,
                          uint32_t threads, const std::vector<float>& min_sizes = {},
                          const DecodedScene* stream_a = nullptr);

}  // namespace l4d::eval
