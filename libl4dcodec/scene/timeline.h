// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>

#include "l4d/l4d.h"
#include "libl4dcodec/math/hd.h"

// The clock of a scene, and which timelines and placements are valid: the rules of the bitstream
// (HEAD-2, HEAD-3), which encoders and renderers hold their input against too.
namespace l4d {

// Zero, or a magnitude far from the ends of the range: then no sum or product of the decoding
// process overflows or is subnormal, and flushing subnormals to zero cannot change a result.
L4D_HOST_DEVICE inline bool is_sound(double v) {
  const double magnitude = v < 0 ? -v : v;
  return v == 0.0 || (magnitude >= 0x1p-60 && magnitude <= 0x1p60);
}

L4D_HOST_DEVICE inline bool has_valid_frames(const l4d_timeline& timeline) {
  return timeline.num_frames >= 1 && timeline.num_frames <= L4D_MAX_FRAMES &&
         timeline.fps_num != 0 && timeline.fps_den != 0;
}

L4D_HOST_DEVICE inline bool is_valid(const l4d_timeline& timeline) {
  return has_valid_frames(timeline) && is_sound(timeline.time_begin);
}
constexpr const char* kTimelineRule =
    "timeline out of range: 1 to 2^24 frames, a positive frame rate";

inline bool is_valid(const l4d_placement& placement) {
  for (const double v : placement.origin) {
    if (!std::isfinite(v)) return false;
  }
  return std::isfinite(placement.scale);
}

L4D_HOST_DEVICE inline double sequence_duration(const l4d_timeline& timeline) {
  return (static_cast<double>(timeline.num_frames) * static_cast<double>(timeline.fps_den)) /
         static_cast<double>(timeline.fps_num);
}

// The time span of a scene, in seconds of some clock.
struct Sequence {
  double begin, end;
  L4D_HOST_DEVICE double center() const { return begin + 0.5 * (end - begin); }
};

L4D_HOST_DEVICE inline Sequence sequence_of(const l4d_timeline& timeline) {
  return {timeline.time_begin, timeline.time_begin + sequence_duration(timeline)};
}

// The time at which positions are coded: the mean time where that is inside the sequence, else the
// end that is nearer to it. A mean far outside would multiply every error of the velocity.
template <typename T>
L4D_HOST_DEVICE inline T reference_time(T mean_t, T begin, T end) {
  return mean_t < begin ? begin : mean_t > end ? end : mean_t;
}

L4D_HOST_DEVICE inline double reference_time(const l4d_timeline& timeline, double mean_t) {
  const Sequence sequence = sequence_of(timeline);
  return reference_time(mean_t, sequence.begin, sequence.end);
}

}  // namespace l4d
