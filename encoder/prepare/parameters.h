// SPDX-License-Identifier: Apache-2.0
// The parameters of the encoder: the one list of their names, ranges and defaults.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "l4d/encode.h"
#include "libl4dcodec/base/status.h"

namespace l4d {

// Numbers first, then lists. encode.h says what they mean, and experimental/parameters.h.
enum class Parameter : uint32_t {
  kLossless,
  kQuality,
  kEffort,
  kMaxPositionError,
  kMaxCovarianceFactor,
  kMaxOpacityError,
  kMaxVisibleError,
  kMaxBaseColorError,
  kMaxDirectionalColorError,
  kDropInvalid,
  kPruneWeight,
  kPruneCost,
  kPageSize,
  kProfile,
  kLevel,
  kCodebookSize,
  kEscapeThreshold,
  kRcq,
  kRcqSize,
  kMergeFraction,
  kMergeCount,
  kClosedLoop,
  kGauge,
  kOpacityBits,
  kScaleFactorBits,
  kKmeansIterations,
  kKmeansSample,
  kZstdLevel,
  kCoding,
  kQualityOffset,
  kFixedPositions,
  kMeanTShift,
  kRans,
  kPositionOffset,
  kCodebooksByCost,
  kRefine,
  kTiers,
  kStages,
  kCount
};
inline constexpr size_t kNumNumbers = static_cast<size_t>(Parameter::kTiers);

struct ParameterDescription {
  const char* name;
  const char* description;
  const char* unit;  // "" = none
  double min, max, initial;
  bool per_component;
  bool integer;
  bool stable;
  uint32_t max_values = 1;  // more than one: a list

  bool is_list() const { return max_values > 1; }
};
const ParameterDescription& describe_parameter(Parameter parameter);

inline constexpr int kAllComponents = -1;
struct NamedParameter {
  Parameter parameter;
  int component;  // or kAllComponents
};
// By its name, and that of a component behind a full stop: "codebook-size.sh".
Status find_parameter(const std::string& name, NamedParameter* out);
const char* component_name(int component);

}  // namespace l4d
