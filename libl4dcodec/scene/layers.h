// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "l4d/l4d.h"
#include "libl4dcodec/math/hd.h"
#include "libl4dcodec/scene/timeline.h"

// Where in time things are stored. The sequence of n frames and duration T is cut into layers:
// layer 0 has one bucket, layer l >= 1 has 2^(l+1) of width T / 2^(l+1). A Gaussian whose extent
// tau = 8 sigma_t is at most T / 2^l may live in layer l, in the bucket of its mean time, and then
// at any time t all visible Gaussians of the layer lie in the bucket of t and its two neighbours:
// visible means |t - mean| <= tau / 2 <= one bucket width, and two times at most one width apart
// are at most one bucket apart, also after both are clamped to the sequence.
//
// Buckets are found in integers, so that writers and readers cannot disagree at a border: a time
// becomes a phase, the 40-bit fraction of the sequence that has passed.
namespace l4d {

constexpr int kPhaseBits = 40;
constexpr uint64_t kPhaseLast = (uint64_t{1} << kPhaseBits) - 1;
constexpr uint32_t kMaxFrames = L4D_MAX_FRAMES;
constexpr uint32_t kMaxLayers = 25;
// Times within this many frames of a frame's beginning are taken to be that frame, because frame
// times such as k / 30 are not binary fractions.
constexpr double kFrameSnap = 1e-6;
// fits_layer judges an extent larger than 8 sigma by this factor: it covers the rounding of readers
// that evaluate the visibility in binary32.
constexpr double kExtentGuard = 1.0 + 0x1p-20;

// ---- layers and buckets -------------------------------------------------------------------------

// ceil(log2 n) + 1: the finest layer's segments last at most one frame. num_frames in [1, 2^24].
L4D_HOST_DEVICE constexpr uint32_t num_layers(uint32_t num_frames) {
  uint32_t layers = 1;
  while ((uint64_t{1} << (layers - 1)) < num_frames) ++layers;
  return layers;
}

// Most layers of a stream: in each level falloffs or windows, coded or stored as they are, and in
// level 0 permanent ones and ones with mean times far outside.
L4D_HOST_DEVICE constexpr uint32_t max_layers(uint32_t num_frames) {
  return 4 * num_layers(num_frames) + 2;
}

// log2 of the number of buckets.
L4D_HOST_DEVICE constexpr int bucket_bits(uint32_t layer) {
  return layer == 0 ? 0 : static_cast<int>(layer) + 1;
}

L4D_HOST_DEVICE constexpr uint32_t num_buckets(uint32_t layer) {
  return uint32_t{1} << bucket_bits(layer);
}

L4D_HOST_DEVICE constexpr uint32_t bucket_of_phase(uint64_t phase, uint32_t layer) {
  return static_cast<uint32_t>(phase >> (kPhaseBits - bucket_bits(layer)));
}

// An inclusive range of buckets of one layer.
struct BucketRange {
  uint32_t first;
  uint32_t last;
};

// The buckets that hold everything of the layer that may be visible somewhere in the phases
// [first, last]: their own and one more on either side.
L4D_HOST_DEVICE constexpr BucketRange buckets_of_phases(uint64_t first, uint64_t last,
                                                        uint32_t layer) {
  const uint32_t begin = bucket_of_phase(first, layer);
  const uint32_t end = bucket_of_phase(last, layer);
  return BucketRange{begin == 0 ? 0 : begin - 1, end + 1 < num_buckets(layer) ? end + 1 : end};
}

L4D_HOST_DEVICE constexpr bool same_or_neighbour(uint32_t bucket_a, uint32_t bucket_b) {
  return bucket_a <= bucket_b ? bucket_b - bucket_a <= 1 : bucket_a - bucket_b <= 1;
}

// ---- phases -------------------------------------------------------------------------------------

// floor(frame 2^40 / num_frames), at most kPhaseLast. Exact: frame is at most 2^24.
L4D_HOST_DEVICE constexpr uint64_t phase_of_frame(uint32_t frame, uint32_t num_frames) {
  return frame >= num_frames ? kPhaseLast
                             : (static_cast<uint64_t>(frame) << kPhaseBits) / num_frames;
}

// Frames from the beginning of the sequence to a time in seconds.
L4D_HOST_DEVICE inline double frames_of_time(const l4d_timeline& timeline, double seconds) {
  return ((seconds - timeline.time_begin) * static_cast<double>(timeline.fps_num)) /
         static_cast<double>(timeline.fps_den);
}

// Phase of a time in seconds, clamped to the sequence; NaN counts as the beginning. Never decreases
// as the time grows: every rounding below is monotone, and a time that just escapes the snap is at
// least kFrameSnap 2^40 / 2^24 = 0.065 phases from the frame, against 2^-13 phases of rounding.
L4D_HOST_DEVICE inline uint64_t phase_of_time(const l4d_timeline& timeline, double seconds) {
  const double n = static_cast<double>(timeline.num_frames);
  const double frames = frames_of_time(timeline, seconds);
  if (!(frames > 0.0)) return 0;
  if (frames >= n) return kPhaseLast;
  const uint32_t nearest = static_cast<uint32_t>(frames + 0.5);
  const double distance = frames - static_cast<double>(nearest);
  if (distance < kFrameSnap && -distance < kFrameSnap) {
    return phase_of_frame(nearest, timeline.num_frames);
  }
  const uint64_t phase = static_cast<uint64_t>((frames / n) * 0x1p40);
  return phase < kPhaseLast ? phase : kPhaseLast;
}

L4D_HOST_DEVICE inline uint32_t bucket_of_time(const l4d_timeline& timeline, double seconds,
                                               uint32_t layer) {
  return bucket_of_phase(phase_of_time(timeline, seconds), layer);
}

// ---- seconds ------------------------------------------------------------------------------------

// The scaling is exact.
L4D_HOST_DEVICE inline double bucket_width(const l4d_timeline& timeline, uint32_t layer) {
  return sequence_duration(timeline) / static_cast<double>(num_buckets(layer));
}

L4D_HOST_DEVICE inline double bucket_center(const l4d_timeline& timeline, uint32_t layer,
                                            uint32_t bucket) {
  return timeline.time_begin + (static_cast<double>(bucket) + 0.5) * bucket_width(timeline, layer);
}

// A mean time of fixed coding, in seconds from the bucket's centre (spec: "Mean time"). `fine` + 1
// is a bit 1 and, below it, further bits of the place inside the step: 0 stands for its middle.
L4D_HOST_DEVICE inline float fixed_mean_time(float step, unsigned zero, uint16_t code,
                                             uint16_t fine) {
  const float whole = static_cast<float>(static_cast<int>(code) - static_cast<int>(zero));
  if (fine == 0) return step * whole;
  const unsigned r = unsigned{fine} + 1;
  unsigned top = 2;  // the highest power of two up to r
  while (top <= r / 2) top *= 2;
  const int middle = static_cast<int>(2 * (r - top) + 1) - static_cast<int>(top);
  return step * (whole + static_cast<float>(middle) / static_cast<float>(2 * top));
}

// ---- the choice of a layer ----------------------------------------------------------------------

// The finest of `layers` layers that may hold an extent of `tau` seconds in a sequence of
// `duration` seconds: clamp(floor(log2(duration / tau)), 0, layers - 1), by comparisons that are
// exact.
L4D_HOST_DEVICE inline uint32_t layer_of_extent(double tau, double duration, uint32_t layers) {
  uint32_t layer = 0;
  double segment = duration * 0.5;
  while (layer + 1 < layers && tau <= segment) {
    ++layer;
    segment *= 0.5;
  }
  return layer;
}

// Whether a Gaussian with these decoded values may live in `bucket` of `layer`: at every time of
// the sequence at which it is visible, the bucket of that time is `bucket` or next to it. Because
// phases are monotone in time, the two ends of the visible interval decide for all of it.
L4D_HOST_DEVICE inline bool fits_layer(double mean_t, double sigma_t, uint32_t bucket,
                                       uint32_t layer, const l4d_timeline& timeline) {
  if (layer == 0) return bucket == 0;
  const double reach = 4.0 * sigma_t * kExtentGuard;
  const double begin = mean_t - reach;
  const double end = mean_t + reach;
  if (!(begin <= end)) return false;  // NaN
  const double sequence_begin = timeline.time_begin;
  const double sequence_end = sequence_begin + sequence_duration(timeline);
  if (end < sequence_begin || begin > sequence_end) return true;  // never visible
  // One phase outward: the means that writer and reader hold may differ in the last place.
  const uint64_t first = phase_of_time(timeline, begin);
  const uint64_t last = phase_of_time(timeline, end);
  return same_or_neighbour(bucket_of_phase(first == 0 ? 0 : first - 1, layer), bucket) &&
         same_or_neighbour(bucket_of_phase(last == kPhaseLast ? last : last + 1, layer), bucket);
}

}  // namespace l4d
