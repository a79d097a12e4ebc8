// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstddef>

#include "l4d/attributes.hpp"
#include "l4d/l4d.h"
#include "libl4dcodec/math/hd.h"
#include "libl4dcodec/scene/window.h"

namespace l4d {

constexpr double kMaxCoordinate = 0x1p60;

// Scenes keep to this, and what is decoded is clamped to it (spec: section 14, "Ranges"), so that
// no covariance and no velocity of a stream overflows binary32.
constexpr float kMaxLogScale = 17;
L4D_HOST_DEVICE inline float clamp_log_scale(float v) {
  return v < -kMaxLogScale ? -kMaxLogScale : v > kMaxLogScale ? kMaxLogScale : v;
}
L4D_HOST_DEVICE inline float clamp_opacity(float v) {
  return v < 0.0f ? 0.0f : v > 1.0f ? 1.0f : v;
}

// How large the numbers of an attribute may be, in the order of the table.
constexpr float kLargestNumbers[kNumAttributes] = {
    static_cast<float>(kMaxCoordinate),
    static_cast<float>(kMaxCoordinate),
    kMaxLogScale,
    1e15f,
    INFINITY,
    65504.0f  // the codebooks hold binary16
};

L4D_HOST_DEVICE inline double mean_time(const l4d_gaussians& gaussians, size_t i) {
  return gaussians.mean_t_double != nullptr ? gaussians.mean_t_double[i]
                                            : static_cast<double>(gaussians.mean_t[i]);
}

L4D_HOST_DEVICE inline FrameWindow window_of(const l4d_gaussians& gaussians, size_t i) {
  if (gaussians.window == nullptr) return {};
  return {gaussians.window[2 * i], gaussians.window[2 * i + 1]};
}

// The rows from `first` on.
inline l4d_gaussians rows_of(const l4d_gaussians& gaussians, uint64_t first, uint64_t count) {
  l4d_gaussians rows = gaussians;
  rows.count = count;
  for_each_attribute(
      [&](const AttributeInfo& a, const float*& values) {
        if (values != nullptr) values += a.numbers(gaussians.sh_degree) * first;
      },
      rows);
  if (rows.mean_t_double != nullptr) rows.mean_t_double += first;
  if (rows.window != nullptr) rows.window += 2 * first;
  return rows;
}

// Whether all arrays are there that a scene of Gaussians needs.
inline bool has_all_arrays(const l4d_gaussians& gaussians) {
  bool all = true;
  for_each_attribute(
      [&](const AttributeInfo& a, const float* values) {
        if (a.flag == info_of(Attribute::kMeanTime).flag && gaussians.mean_t_double != nullptr) {
          return;
        }
        all = all && values != nullptr;
      },
      gaussians);
  return all;
}

// Whether Gaussian i has no window, or one inside the sequence.
inline bool has_valid_window(const l4d_gaussians& gaussians, size_t i, uint32_t num_frames) {
  const FrameWindow window = window_of(gaussians, i);
  return (window.begin == 0 && window.end == 0) || window.is_valid(num_frames);
}

// Name of the first attribute of Gaussian i that is no value a scene may hold, or null.
inline const char* invalid_attribute(const l4d_gaussians& g, size_t i) {
  const char* invalid = nullptr;
  size_t index = 0;
  for_each_attribute(
      [&](const AttributeInfo& a, const float* values) {
        const float largest = kLargestNumbers[index++];
        if (invalid != nullptr) return;
        bool valid = true;
        if (a.flag == info_of(Attribute::kMeanTime).flag) {
          valid = std::fabs(mean_time(g, i)) <= kMaxCoordinate;
        } else if (a.flag == info_of(Attribute::kOpacity).flag) {
          const bool logit = (g.flags & L4D_OPACITY_LOGIT) != 0;
          valid = logit ? std::isfinite(values[i]) : values[i] >= 0 && values[i] <= 1;
        } else {
          const size_t n = a.numbers(g.sh_degree);
          for (size_t k = 0; k < n; ++k) valid = valid && std::fabs(values[n * i + k]) <= largest;
        }
        if (!valid) invalid = a.name;
      },
      g);
  return invalid;
}

}  // namespace l4d
