// SPDX-License-Identifier: Apache-2.0
// Long sequences: buckets at their borders, mean times, and what is left of a difference of times.
#include <algorithm>
#include <cmath>

#include "libl4dcodec/base/half.h"
#include "libl4dcodec/scene/layers.h"
#include "tests/math/reference.h"
#include "tests/numerics/formula.h"

namespace l4d::numerics {
namespace {

using reference::Random;
using reference::Real;

l4d_timeline make_timeline(double begin, uint32_t frames, uint32_t num, uint32_t den) {
  l4d_timeline t{};
  t.time_begin = begin;
  t.num_frames = frames;
  t.fps_num = num;
  t.fps_den = den;
  return t;
}

const l4d_timeline kLong[] = {
    make_timeline(0.0, 36000, 60, 1),             // 10 minutes
    make_timeline(12.34, 35964, 60000, 1001),     // 10 minutes of a broadcast
    make_timeline(0.0, 5184000, 60, 1),           // 24 hours
    make_timeline(-3600.1, 5178822, 60000, 1001)  // 24 hours of a broadcast, from before zero
};

// Exhaustive up to here, a sample beyond.
constexpr uint32_t kAllBuckets = 1u << 12;

double seconds_of_frames(const l4d_timeline& t, double frames) {
  return frames * t.fps_den / t.fps_num;
}

// How many frames `time` lies outside the bucket that it was given, to either side.
double outside(const l4d_timeline& t, double time, uint32_t bucket, uint32_t layer) {
  const Real frames = (Real(time) - Real(t.time_begin)) * t.fps_num / t.fps_den;
  const Real n = t.num_frames;
  const Real width = n / num_buckets(layer);
  const Real inside = std::clamp(frames, Real(0), n);
  return static_cast<double>(
      std::max({Real(0), width * bucket - inside, inside - width * (Real(bucket) + 1)}));
}

// As one would: seconds in binary32, divided by the width.
uint32_t naive_bucket(const l4d_timeline& t, double time, uint32_t layer) {
  const float elapsed = static_cast<float>(time) - static_cast<float>(t.time_begin);
  const float buckets = static_cast<float>(num_buckets(layer));
  const float k = std::floor(elapsed / static_cast<float>(bucket_width(t, layer)));
  return static_cast<uint32_t>(std::clamp(k, 0.0f, buckets - 1));
}

Observed bucket_borders() {
  Random random(131);
  Observed o;
  for (const l4d_timeline& t : kLong) {
    const uint32_t layers = num_layers(t.num_frames);
    for (uint32_t layer = 0; layer < layers; ++layer) {
      const uint64_t buckets = num_buckets(layer);
      const uint64_t tried = std::min<uint64_t>(buckets + 1, kAllBuckets);
      for (uint64_t i = 0; i < tried; ++i) {
        const uint64_t k = buckets < kAllBuckets ? i : random.below(buckets + 1);
        const double share = static_cast<double>(k) / static_cast<double>(buckets);
        const double border = t.time_begin + sequence_duration(t) * share;
        const double frame = std::round(share * t.num_frames);
        const double nearest = t.time_begin + seconds_of_frames(t, frame);
        const double snap = seconds_of_frames(t, kFrameSnap * 0.999);
        for (const double time :
             {border, std::nextafter(border, -HUGE_VAL), std::nextafter(border, HUGE_VAL), nearest,
              nearest - snap, nearest + snap, border - 1, border + 1}) {
          o.add(outside(t, time, bucket_of_time(t, time, layer), layer));
          o.add_naive(outside(t, time, naive_bucket(t, time, layer), layer));
        }
      }
    }
  }
  return o;
}

struct CodedMean {
  double mean, center, width;
  float local;
};

CodedMean random_mean(Random& random) {
  const l4d_timeline& t = kLong[random.below(std::size(kLong))];
  const uint32_t layer = static_cast<uint32_t>(random.below(num_layers(t.num_frames)));
  CodedMean m;
  m.mean = t.time_begin + sequence_duration(t) * random.uniform();
  m.width = bucket_width(t, layer);
  m.center = bucket_center(t, layer, bucket_of_time(t, m.mean, layer));
  const uint16_t code = float_to_half(static_cast<float>((m.mean - m.center) / m.width));
  m.local = static_cast<float>(m.width) * half_to_float(code);
  return m;
}

Observed mean_time() {
  Random random(132);
  Observed o;
  for (int i = 0; i < 200000; ++i) {
    const CodedMean m = random_mean(random);
    o.add(std::fabs(m.center + static_cast<double>(m.local) - m.mean) / m.width);
    const float naive = half_to_float(float_to_half(static_cast<float>(m.mean)));
    o.add_naive(std::fabs(static_cast<double>(naive) - m.mean) / m.width);
  }
  return o;
}

// t - mean as the slicer has it, at instants in the same bucket and its neighbours.
Observed elapsed_time() {
  Random random(133);
  Observed o;
  for (int i = 0; i < 200000; ++i) {
    const CodedMean m = random_mean(random);
    const double time = m.center + m.width * random.uniform(-1.5, 1.5);
    const Real exact = Real(time) - (Real(m.center) + Real(m.local));
    const float ours = static_cast<float>(time - m.center) - m.local;
    const float mean = static_cast<float>(m.center + static_cast<double>(m.local));
    const float naive = static_cast<float>(time) - mean;
    o.add(static_cast<double>(std::fabs(Real(ours) - exact)) / m.width);
    o.add_naive(static_cast<double>(std::fabs(Real(naive) - exact)) / m.width);
  }
  return o;
}

std::vector<Formula> list() {
  static constexpr char kSequences[] = "10 minutes and 24 hours at 60 and 59.94 frames/s";
  return {
      {"time_bucket", "bucket_of_time", "exact share of the sequence, long double",
       "10 minutes and 24 hours at 60 and 59.94 frames/s: both edges of all buckets of coarse "
       "layers, of 4096 of each fine one; frames and what snaps to them; times outside",
       "frames between the time and its bucket", "frames are snapped to within 1e-6",
       "seconds in binary32", 1.01e-6, bucket_borders},
      {"time_mean", "binary16 of (mean - centre) / width, and back", "the mean time", kSequences,
       "error : bucket width", "half a step of binary16 below 1/2; binary32 of the width",
       "binary16 of the seconds", 0x1p-13 * 1.001, mean_time},
      {"time_elapsed", "float(t - centre) - local", "long double", kSequences,
       "error : bucket width", "3 roundings of numbers up to 2 widths; binary64 of 24 hours",
       "difference of seconds in binary32", 4 * kU32, elapsed_time},
  };
}
const Register kRegister(list);

}  // namespace
}  // namespace l4d::numerics
