// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

#include "libl4dcodec/scene/slice.h"

namespace l4d::train {

// When a Gaussian is visible: from `begin` to `end`, in seconds, on host and devices. The bounds
// are wider than rounding needs; those of a row that is not finite are infinite.
struct RowSpan {
  uint32_t id;
  float begin, end;
};

constexpr float kSpanMargin = 1.01f;  // times the length of a span

L4D_HOST_DEVICE inline RowSpan span_of(const float* rotor, const float* log_scale, float mean_t,
                                       uint32_t id) {
  float p[3][4];
  const Slice4D<float> slice = slice_attributes<float>(rotor, log_scale, p);
  const float half =
      kSpanMargin * std::sqrt(kVisibilityGate / slice.lambda) + 1e-6f * std::fabs(mean_t);
  RowSpan span{id, mean_t - half, mean_t + half};
  if (!(span.begin <= span.end)) {
    span.begin = -INFINITY;
    span.end = INFINITY;
  }
  return span;
}

// A part of a sequence, in seconds; both ends belong to it.
struct TimeInterval {
  double begin, end;
};

inline bool meets(const RowSpan& span, const TimeInterval& time) {
  return static_cast<double>(span.begin) <= time.end && static_cast<double>(span.end) >= time.begin;
}

inline bool meets_any(const RowSpan& span, const std::vector<TimeInterval>& times) {
  for (const TimeInterval& time : times) {
    if (meets(span, time)) return true;
  }
  return false;
}

}  // namespace l4d::train
