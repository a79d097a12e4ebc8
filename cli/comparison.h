// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "cli/common.h"
#include "cli/pairing.h"
#include "cli/scene_source.h"

namespace l4d::cli {

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
  double least_size = 0;             // scene units: smaller sizes count as this
  std::vector<SeenError> seen;

  // Same Gaussians bit for bit, in any order.
  bool identical() const { return pairing.equal_rows == count_a && count_a == count_b; }
  Json json() const;
  std::string text() const;
  // Largest error of an attribute, visible_position, or an error of `seen`.
  double max_error(const std::string& name) const;
};

// "position=0.001", as --max-error takes it. Usage errors: no number, and names that no comparison
// has.
struct ErrorBound {
  std::string name;
  double limit = 0;
};
ErrorBound parse_error_bound(const std::string& text);

Comparison compare_scenes(const io::Scene& a, const LoadedScene& b, Pairing pairing,
                          uint32_t threads);

}  // namespace l4d::cli
