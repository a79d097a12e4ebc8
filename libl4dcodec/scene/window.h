// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>

#include "l4d/l4d.h"
#include "libl4dcodec/math/hd.h"
#include "libl4dcodec/scene/layers.h"

// Flat temporal windows (spec: section 15.6): a Gaussian has its full opacity in the frames from
// `begin` to `end` - 1 and is not there in any other. Every time belongs to exactly one frame, so
// windows that meet in frames tile time: at no instant are two of them shown, or none.
namespace l4d {

// Times up to this many frames before a frame begins belong to it, because the time of a frame is
// in general no binary fraction.
constexpr double kFrameSlack = 0x1p-11;
// Times of the sequence are at most this many frames from 0, so that binary64 tells frames apart:
// the time of a frame is off by less than kFrameSlack.
constexpr double kMaxClockFrames = 0x1p40;

// The frames begin..end-1; begin = end = 0: the Gaussian has no flat window.
struct alignas(8) FrameWindow {
  uint32_t begin = 0, end = 0;

  L4D_HOST_DEVICE constexpr bool is_flat() const { return end != 0; }
  L4D_HOST_DEVICE constexpr bool holds(uint32_t frame) const {
    return begin <= frame && frame < end;
  }
  // Whether nothing but its falloff hides the Gaussian in this frame.
  L4D_HOST_DEVICE constexpr bool shows(uint32_t frame) const { return !is_flat() || holds(frame); }
  L4D_HOST_DEVICE constexpr bool is_valid(uint32_t num_frames) const {
    return begin < end && end <= num_frames;
  }
};

// The frame that a time belongs to, clamped to the sequence; NaN counts as the beginning. Never
// decreases as the time grows.
L4D_HOST_DEVICE inline uint32_t frame_of_time(const l4d_timeline& timeline, double seconds) {
  const double frames = frames_of_time(timeline, seconds);
  const uint32_t last = timeline.num_frames - 1;
  if (!(frames > 0.0)) return 0;
  if (frames >= static_cast<double>(timeline.num_frames)) return last;
  const uint32_t frame = static_cast<uint32_t>(frames + kFrameSlack);
  return frame < last ? frame : last;
}

L4D_HOST_DEVICE inline bool tells_frames_apart(const l4d_timeline& timeline) {
  const double farthest = std::fabs(timeline.time_begin) + sequence_duration(timeline);
  return (farthest * static_cast<double>(timeline.fps_num)) /
             static_cast<double>(timeline.fps_den) <=
         kMaxClockFrames;
}

L4D_HOST_DEVICE inline double time_of_frame(const l4d_timeline& timeline, double frame) {
  return timeline.time_begin +
         (frame * static_cast<double>(timeline.fps_den)) / static_cast<double>(timeline.fps_num);
}

// The exact mean time of a Gaussian with a window, and so its reference time.
L4D_HOST_DEVICE inline double window_middle(const l4d_timeline& timeline, FrameWindow window) {
  const double sum = static_cast<double>(uint64_t{window.begin} + window.end);
  return timeline.time_begin +
         ((sum * static_cast<double>(timeline.fps_den)) / static_cast<double>(timeline.fps_num)) *
             0.5;
}

// The times of the sequence outside which no time belongs to a frame of the window.
L4D_HOST_DEVICE inline Sequence window_times(const l4d_timeline& timeline, FrameWindow window) {
  return {time_of_frame(timeline, window.begin == 0 ? 0.0 : window.begin - 2 * kFrameSlack),
          time_of_frame(timeline, window.end)};
}

// The first and the last phase that a time in the window may have, and some to either side.
struct PhaseRange {
  uint64_t first, last;
};
L4D_HOST_DEVICE constexpr PhaseRange phases_of_window(FrameWindow window, uint32_t num_frames) {
  const uint64_t begin = phase_of_frame(window.begin, num_frames);
  const uint64_t slack = (uint64_t{1} << (kPhaseBits - 10)) / num_frames;
  return PhaseRange{
      begin < slack ? 0 : begin - slack,
      window.end >= num_frames ? kPhaseLast : phase_of_frame(window.end, num_frames) - 1};
}

// Whether a Gaussian with this window may live in `bucket` of `layer` (LAYR-3): at every time in
// the window, the bucket of that time is `bucket` or next to it.
L4D_HOST_DEVICE constexpr bool window_fits(FrameWindow window, uint32_t bucket, uint32_t layer,
                                           uint32_t num_frames) {
  const PhaseRange phases = phases_of_window(window, num_frames);
  return same_or_neighbour(bucket_of_phase(phases.first, layer), bucket) &&
         same_or_neighbour(bucket_of_phase(phases.last, layer), bucket);
}

// A bucket of the layer that the window fits, if there is one: that in which the window begins, or
// the next.
L4D_HOST_DEVICE constexpr uint32_t bucket_of_window(FrameWindow window, uint32_t layer,
                                                    uint32_t num_frames) {
  const PhaseRange phases = phases_of_window(window, num_frames);
  const uint32_t first = bucket_of_phase(phases.first, layer);
  const uint32_t last = bucket_of_phase(phases.last, layer);
  return last - first > 1 ? first + 1
                          : bucket_of_phase(phase_of_frame(window.begin, num_frames), layer);
}

// The finest of `layers` layers in which the window fits a bucket.
L4D_HOST_DEVICE constexpr uint32_t layer_of_window(FrameWindow window, uint32_t num_frames,
                                                   uint32_t layers) {
  uint32_t layer = layers - 1;
  while (layer > 0 &&
         !window_fits(window, bucket_of_window(window, layer, num_frames), layer, num_frames)) {
    --layer;
  }
  return layer;
}

// The frame that coded begins of a bucket count from: a window that fits the bucket begins there or
// later.
L4D_HOST_DEVICE constexpr uint32_t window_base(uint32_t bucket, uint32_t layer,
                                               uint32_t num_frames) {
  const uint64_t before = bucket == 0 ? 0 : bucket - 1;
  return static_cast<uint32_t>((before * num_frames) >> bucket_bits(layer));
}

}  // namespace l4d
