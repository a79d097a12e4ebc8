// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/scene/layers.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <limits>
#include <vector>

#include "libl4dcodec/scene/slice.h"
#include "tests/math/reference.h"

namespace l4d {
namespace {

using reference::Random;
using reference::Real;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

l4d_timeline make_timeline(double begin, uint32_t frames, uint32_t num, uint32_t den) {
  l4d_timeline timeline{};
  timeline.time_begin = begin;
  timeline.num_frames = frames;
  timeline.fps_num = num;
  timeline.fps_den = den;
  return timeline;
}

const l4d_timeline kTimelines[] = {
    make_timeline(0.0, 1, 30, 1),              // one frame
    make_timeline(-2.5, 7, 24000, 1001),       // nothing divides anything
    make_timeline(0.0, 150, 30, 1),            // 5 s
    make_timeline(12.34, 300, 30, 1),          // 10 s, not from zero
    make_timeline(0.0, 36000, 60, 1),          // 10 minutes at 60 fps
    make_timeline(100.0, 35964, 60000, 1001),  // 10 minutes, broadcast rate
    make_timeline(0.0, 5184000, 60, 1),        // 24 hours at 60 fps
    make_timeline(0.0, 1u << 24, 240, 1),      // the longest
};

double time_of_frame(const l4d_timeline& t, uint32_t frame) {
  return t.time_begin + static_cast<double>(frame) * t.fps_den / t.fps_num;
}

TEST(Layers, NumberOfLayers) {
  EXPECT_EQ(num_layers(1), 1u);
  EXPECT_EQ(num_layers(2), 2u);
  EXPECT_EQ(num_layers(3), 3u);
  EXPECT_EQ(num_layers(4), 3u);
  EXPECT_EQ(num_layers(5), 4u);
  EXPECT_EQ(num_layers(300), 10u);
  EXPECT_EQ(num_layers(1200), 12u);
  EXPECT_EQ(num_layers(3600), 13u);
  EXPECT_EQ(num_layers(36000), 17u);
  EXPECT_EQ(num_layers(kMaxFrames), kMaxLayers);
}

TEST(Layers, NumberOfBuckets) {
  EXPECT_EQ(num_buckets(0), 1u);
  EXPECT_EQ(num_buckets(1), 4u);
  EXPECT_EQ(num_buckets(2), 8u);
  EXPECT_EQ(num_buckets(kMaxLayers - 1), 1u << 25);
}

TEST(Layers, FramesLandInTheirBuckets) {
  for (const l4d_timeline& timeline : kTimelines) {
    const uint32_t n = timeline.num_frames;
    const uint32_t stride = n > 100000 ? 97 : 1;
    const uint32_t layers = num_layers(n);
    for (uint64_t k = 0; k < n; k += stride) {
      const uint64_t phase = phase_of_frame(static_cast<uint32_t>(k), n);
      for (uint32_t layer = 0; layer < layers; ++layer) {
        const uint64_t exact = layer == 0 ? 0 : (k << (layer + 1)) / n;
        ASSERT_EQ(bucket_of_phase(phase, layer), exact) << "frame " << k << " of " << n;
      }
    }
    EXPECT_EQ(phase_of_frame(n, n), kPhaseLast);
  }
}

TEST(Layers, FrameTimesAreFrames) {
  for (const l4d_timeline& timeline : kTimelines) {
    const uint32_t stride = timeline.num_frames > 100000 ? 97 : 1;
    for (uint32_t k = 0; k < timeline.num_frames; k += stride) {
      const double t = time_of_frame(timeline, k);
      const uint64_t phase = phase_of_frame(k, timeline.num_frames);
      ASSERT_EQ(phase_of_time(timeline, t), phase);
      ASSERT_EQ(phase_of_time(timeline, std::nextafter(t, -kInfinity)), phase);
      ASSERT_EQ(phase_of_time(timeline, std::nextafter(t, kInfinity)), phase);
    }
  }
}

TEST(Layers, PhasesAreClamped) {
  for (const l4d_timeline& timeline : kTimelines) {
    const double end = timeline.time_begin + sequence_duration(timeline);
    EXPECT_EQ(phase_of_time(timeline, -kInfinity), 0u);
    EXPECT_EQ(phase_of_time(timeline, timeline.time_begin - 1e9), 0u);
    EXPECT_EQ(phase_of_time(timeline, timeline.time_begin), 0u);
    EXPECT_EQ(phase_of_time(timeline, kNan), 0u);
    EXPECT_EQ(phase_of_time(timeline, end), kPhaseLast);
    EXPECT_EQ(phase_of_time(timeline, end + 1e9), kPhaseLast);
    EXPECT_EQ(phase_of_time(timeline, kInfinity), kPhaseLast);
  }
}

TEST(Layers, PhasesApproximateTheFraction) {
  Random random(31);
  for (const l4d_timeline& timeline : kTimelines) {
    const double snap = kFrameSnap * 0x1p40 / timeline.num_frames;  // phases
    for (int i = 0; i < 20000; ++i) {
      const double t = timeline.time_begin + random.uniform() * sequence_duration(timeline);
      const Real exact = (Real(t) - Real(timeline.time_begin)) * timeline.fps_num /
                         timeline.fps_den / timeline.num_frames * 0x1p40L;
      const Real error = Real(phase_of_time(timeline, t)) - exact;
      ASSERT_LT(std::fabs(static_cast<double>(error)), 1.01 + snap);
    }
  }
}

TEST(Layers, PhasesNeverDecrease) {
  Random random(32);
  for (const l4d_timeline& timeline : kTimelines) {
    const double frame = sequence_duration(timeline) / timeline.num_frames;
    for (int i = 0; i < 50000; ++i) {
      // About the ends of the snap interval of a frame, where order is at stake.
      const uint32_t k = static_cast<uint32_t>(random.below(timeline.num_frames + 1ull));
      const double side = random.uniform() < 0.5 ? -kFrameSnap : kFrameSnap;
      double t = time_of_frame(timeline, k) + side * frame * random.uniform(0.999, 1.001);
      uint64_t phase = phase_of_time(timeline, t);
      for (int step = 0; step < 8; ++step) {
        t = step % 2 == 0 ? std::nextafter(t, kInfinity) : t + frame * 1e-9 * random.uniform();
        const uint64_t next = phase_of_time(timeline, t);
        ASSERT_LE(phase, next);
        phase = next;
      }
      const double a = random.uniform(-0.1, 1.1) * sequence_duration(timeline);
      const double b = random.uniform(-0.1, 1.1) * sequence_duration(timeline);
      ASSERT_LE(phase_of_time(timeline, timeline.time_begin + std::min(a, b)),
                phase_of_time(timeline, timeline.time_begin + std::max(a, b)));
    }
  }
}

TEST(Layers, BucketGeometry) {
  const l4d_timeline timeline = make_timeline(2.0, 300, 30, 1);
  EXPECT_EQ(sequence_duration(timeline), 10.0);
  EXPECT_EQ(bucket_width(timeline, 0), 10.0);
  EXPECT_EQ(bucket_center(timeline, 0, 0), 7.0);
  EXPECT_EQ(bucket_width(timeline, 1), 2.5);
  EXPECT_EQ(bucket_center(timeline, 1, 3), 2.0 + 8.75);
  for (const l4d_timeline& t : kTimelines) {
    for (uint32_t layer = 0; layer < num_layers(t.num_frames); ++layer) {
      EXPECT_EQ(bucket_width(t, layer) * num_buckets(layer), sequence_duration(t));
      const uint32_t last = num_buckets(layer) - 1;
      for (const uint32_t b : {0u, last / 3, last / 2, last}) {
        EXPECT_EQ(bucket_of_time(t, bucket_center(t, layer, b), layer), b);
      }
    }
  }
}

TEST(Layers, BucketsNeeded) {
  const uint64_t quarter = uint64_t{1} << 38;
  const auto equal = [](BucketRange range, uint32_t first, uint32_t last) {
    return range.first == first && range.last == last;
  };
  EXPECT_TRUE(equal(buckets_of_phases(0, 0, 0), 0, 0));
  EXPECT_TRUE(equal(buckets_of_phases(kPhaseLast, kPhaseLast, 0), 0, 0));
  EXPECT_TRUE(equal(buckets_of_phases(0, 0, 1), 0, 1));
  EXPECT_TRUE(equal(buckets_of_phases(quarter - 1, quarter - 1, 1), 0, 1));
  EXPECT_TRUE(equal(buckets_of_phases(quarter, quarter, 1), 0, 2));
  EXPECT_TRUE(equal(buckets_of_phases(kPhaseLast, kPhaseLast, 1), 2, 3));
  EXPECT_TRUE(equal(buckets_of_phases(quarter, 2 * quarter, 2), 1, 5));
  EXPECT_TRUE(equal(buckets_of_phases(0, kPhaseLast, 5), 0, 63));
  EXPECT_TRUE(same_or_neighbour(3, 4));
  EXPECT_TRUE(same_or_neighbour(4, 3));
  EXPECT_TRUE(same_or_neighbour(0, 0));
  EXPECT_FALSE(same_or_neighbour(0, 2));
  EXPECT_FALSE(same_or_neighbour(0xffffffffu, 0));
}

TEST(Layers, ReferenceTimeIsInTheSequence) {
  const l4d_timeline timeline = make_timeline(2.0, 150, 30, 1);
  EXPECT_EQ(reference_time(timeline, -200.0), 2.0);
  EXPECT_EQ(reference_time(timeline, 3.25), 3.25);
  EXPECT_EQ(reference_time(timeline, 200.0), 7.0);
}

TEST(Layers, LayerOfExtent) {
  for (const double duration : {5.0, 600.0, 86400.0, 1.0 / 3.0}) {
    EXPECT_EQ(layer_of_extent(2 * duration, duration, 10), 0u);
    EXPECT_EQ(layer_of_extent(kInfinity, duration, 10), 0u);
    EXPECT_EQ(layer_of_extent(kNan, duration, 10), 0u);
    EXPECT_EQ(layer_of_extent(0.0, duration, 10), 9u);
    EXPECT_EQ(layer_of_extent(0.0, duration, 1), 0u);
    for (uint32_t layer = 0; layer < 10; ++layer) {
      const double segment = std::ldexp(duration, -static_cast<int>(layer));
      EXPECT_EQ(layer_of_extent(segment, duration, 10), layer);
      EXPECT_EQ(layer_of_extent(std::nextafter(segment, kInfinity), duration, 10),
                layer == 0 ? 0 : layer - 1);
    }
    Random random(33);
    for (int i = 0; i < 10000; ++i) {
      const double tau = random.log_uniform(duration * 1e-4, duration * 4);
      const double by_log = std::floor(std::log2(duration / tau));
      EXPECT_EQ(layer_of_extent(tau, duration, 12),
                static_cast<uint32_t>(std::clamp(by_log, 0.0, 11.0)));
    }
  }
}

TEST(Layers, Visibility) {
  EXPECT_TRUE(is_visible(1.0f, 4.0f));
  EXPECT_TRUE(is_visible(1.0f, -4.0f));
  EXPECT_FALSE(is_visible(1.0f, std::nextafter(4.0f, 5.0f)));
  EXPECT_FALSE(is_visible(1.0f, std::numeric_limits<float>::quiet_NaN()));
  EXPECT_TRUE(is_visible(0.25, 8.0));
}

// ---- the theorem: three buckets are enough ------------------------------------------------------

// Times at which a Gaussian visible in [mean - reach, mean + reach] could defeat a bucket: the
// ends, the borders of all nearby buckets, frames, each with its neighbours in floating point.
std::vector<double> critical_times(Random& random, const l4d_timeline& timeline, uint32_t layer,
                                   double mean, double reach) {
  const double begin = timeline.time_begin;
  const double end = begin + sequence_duration(timeline);
  const double width = bucket_width(timeline, layer);
  std::vector<double> times;
  for (const double t : {mean - reach, mean, mean + reach, begin, end}) times.push_back(t);
  const double nearest = std::floor((mean - begin) / width);
  for (int k = -3; k <= 4; ++k) times.push_back(begin + (nearest + k) * width);
  for (int k = 0; k < 6; ++k) {
    const double t = mean + reach * random.uniform(-1.0, 1.0);
    times.push_back(t);
    const double frame = std::floor((t - begin) * timeline.fps_num / timeline.fps_den);
    times.push_back(begin + frame * timeline.fps_den / timeline.fps_num);
  }
  const size_t count = times.size();
  for (size_t i = 0; i < count; ++i) {
    times.push_back(std::nextafter(times[i], -kInfinity));
    times.push_back(std::nextafter(times[i], kInfinity));
  }
  for (double& t : times) t = std::clamp(t, begin, end);
  return times;
}

double random_mean(Random& random, const l4d_timeline& timeline, uint32_t layer) {
  const double begin = timeline.time_begin;
  const double duration = sequence_duration(timeline);
  const double width = bucket_width(timeline, layer);
  const double border =
      begin + static_cast<double>(random.below(num_buckets(layer) + 1ull)) * width;
  switch (random.below(6)) {
    case 0:
      return border;
    case 1:
      return std::nextafter(border, random.uniform() < 0.5 ? -kInfinity : kInfinity);
    case 2:
      return border + width * random.uniform(-1e-6, 1e-6);
    case 3:  // outside
      return random.uniform() < 0.5 ? begin - random.uniform(0.0, 2.0) * width
                                    : begin + duration + random.uniform(0.0, 2.0) * width;
    default:
      return begin + duration * random.uniform();
  }
}

TEST(Layers, ThreeBucketsAreEnough) {
  Random random(34);
  int64_t accepted = 0, offered = 0, visible = 0;
  for (const l4d_timeline& timeline : kTimelines) {
    const double duration = sequence_duration(timeline);
    const uint32_t layers = num_layers(timeline.num_frames);
    if (layers == 1) continue;
    for (int i = 0; i < 40000; ++i) {
      const uint32_t layer = 1 + static_cast<uint32_t>(random.below(layers - 1));
      const double segment = std::ldexp(duration, -static_cast<int>(layer));
      // Mostly the largest extents a layer admits: there the neighbours are needed in full.
      const double tau = random.uniform() < 0.5 ? segment : segment * random.uniform();
      const double sigma = tau / 8;
      const double mean = random_mean(random, timeline, layer);
      const uint32_t bucket = bucket_of_time(timeline, mean, layer);
      ASSERT_GE(layer_of_extent(tau, duration, layers), layer);
      ++offered;
      if (!fits_layer(mean, sigma, bucket, layer, timeline)) continue;
      ++accepted;
      const double lambda = 1.0 / (sigma * sigma);
      const float narrow_lambda = static_cast<float>(lambda);
      for (const double t : critical_times(random, timeline, layer, mean, 4 * sigma)) {
        const Real dt = Real(t) - Real(mean);
        const bool exact = dt * dt <= 16 * Real(sigma) * Real(sigma);
        const bool narrow = is_visible(narrow_lambda, static_cast<float>(t - mean));
        if (!exact && !narrow) continue;
        ++visible;
        const uint32_t at = bucket_of_time(timeline, t, layer);
        ASSERT_TRUE(same_or_neighbour(at, bucket))
            << "t " << t << " mean " << mean << " sigma " << sigma << " layer " << layer;
        const uint64_t phase = phase_of_time(timeline, t);
        const BucketRange needed = buckets_of_phases(phase, phase, layer);
        ASSERT_TRUE(needed.first <= bucket && bucket <= needed.last);
      }
    }
  }
  std::cout << "theorem: " << accepted << " of " << offered << " Gaussians, " << visible
            << " visible times, no violation\n";
  EXPECT_GT(visible, accepted);
}

// fits_layer gives away next to nothing: what is a little smaller than the layer admits always
// fits.
TEST(Layers, AdmittedExtentsFit) {
  Random random(35);
  for (const l4d_timeline& timeline : kTimelines) {
    const uint32_t layers = num_layers(timeline.num_frames);
    for (int i = 0; i < 40000; ++i) {
      const uint32_t layer = static_cast<uint32_t>(random.below(layers));
      const double segment = std::ldexp(sequence_duration(timeline), -static_cast<int>(layer));
      // The guard on the extent, the snap to frames, and two phases of the bucket.
      const double slack = 1e-5 + std::ldexp(2.0, bucket_bits(layer) - kPhaseBits);
      const double share = random.uniform() < 0.5 ? 1.0 : random.uniform();
      const double sigma = segment * share * (1.0 - slack) / 8;
      const double mean = random_mean(random, timeline, layer);
      const uint32_t bucket = bucket_of_time(timeline, mean, layer);
      ASSERT_TRUE(fits_layer(mean, sigma, bucket, layer, timeline))
          << "mean " << mean << " sigma " << sigma << " layer " << layer;
    }
  }
}

// Against brute force: all borders of buckets decide whether some visible time is too far away.
TEST(Layers, FitsLayerDecidesAsBruteForce) {
  Random random(36);
  const l4d_timeline timeline = make_timeline(3.0, 300, 30, 1);
  const double begin = timeline.time_begin, end = begin + sequence_duration(timeline);
  int fits_count = 0, violations = 0;
  for (int i = 0; i < 50000; ++i) {
    const uint32_t layer = 1 + static_cast<uint32_t>(random.below(7));
    const double width = bucket_width(timeline, layer);
    const double mean = begin + random.uniform(-0.3, 1.3) * (end - begin);
    const double sigma = width * random.uniform(0.05, 1.0);
    const uint32_t bucket = bucket_of_time(timeline, mean, layer);
    // The furthest bucket touched by [mean - reach, mean + reach] within the sequence.
    const auto too_far = [&](double reach) {
      const double low = std::max(mean - reach, begin), high = std::min(mean + reach, end);
      if (low > high) return false;
      for (uint32_t b = 0; b < num_buckets(layer); ++b) {
        const double left = begin + b * width;
        const bool touched =
            b + 1 == num_buckets(layer) ? high >= left : low < left + width && high >= left;
        if (touched && !same_or_neighbour(b, bucket)) return true;
      }
      return false;
    };
    const bool fits = fits_layer(mean, sigma, bucket, layer, timeline);
    if (too_far(4 * sigma * (1 - 1e-5))) {
      ++violations;
      ASSERT_FALSE(fits);
    }
    if (!too_far(4 * sigma * (1 + 1e-5))) {
      ++fits_count;
      ASSERT_TRUE(fits);
    }
  }
  EXPECT_GT(fits_count, 5000);
  EXPECT_GT(violations, 5000);
}

TEST(Layers, FitsLayerOnExtremes) {
  const l4d_timeline timeline = make_timeline(0.0, 300, 30, 1);
  EXPECT_TRUE(fits_layer(5.0, 1e30, 0, 0, timeline));
  EXPECT_TRUE(fits_layer(5.0, kInfinity, 0, 0, timeline));
  EXPECT_FALSE(fits_layer(5.0, kInfinity, 2, 1, timeline));
  EXPECT_FALSE(fits_layer(kNan, 1.0, 0, 1, timeline));
  EXPECT_FALSE(fits_layer(5.0, kNan, 2, 1, timeline));
  EXPECT_FALSE(fits_layer(5.0, -1.0, 2, 1, timeline));
  // Outside and never seen, outside and seen only at the near end, outside and seen too long.
  EXPECT_TRUE(fits_layer(-100.0, 1.0, 0, 1, timeline));
  EXPECT_TRUE(fits_layer(-100.0, 25.2, 0, 1, timeline));
  EXPECT_FALSE(fits_layer(-100.0, 27.0, 0, 1, timeline));
  EXPECT_TRUE(fits_layer(110.0, 25.2, 3, 1, timeline));
  EXPECT_FALSE(fits_layer(110.0, 27.0, 3, 1, timeline));
}

// The last phase before a bucket that is too far away already counts as that bucket.
TEST(Layers, FitsLayerKeepsOnePhaseOfMargin) {
  const l4d_timeline timeline = make_timeline(0.0, 7, 1, 1);
  const double border = 3.5;  // where bucket 2 of layer 1 begins, not at a frame
  const double phase = 7.0 * 0x1p-40;
  const auto sigma_to_end_at = [](double end) { return (end - 1.0) / 4.0 / kExtentGuard; };
  ASSERT_EQ(phase_of_time(timeline, border - 0.5 * phase), (uint64_t{1} << 39) - 1);
  EXPECT_FALSE(fits_layer(1.0, sigma_to_end_at(border - 0.5 * phase), 0, 1, timeline));
  EXPECT_TRUE(fits_layer(1.0, sigma_to_end_at(border - 1.5 * phase), 0, 1, timeline));
  // The same at the other end: bucket 1 ends there, and 3 is the bucket of the mean.
  const auto sigma_to_begin_at = [](double begin) { return (6.0 - begin) / 4.0 / kExtentGuard; };
  EXPECT_FALSE(fits_layer(6.0, sigma_to_begin_at(border + 0.5 * phase), 3, 1, timeline));
  EXPECT_TRUE(fits_layer(6.0, sigma_to_begin_at(border + 1.5 * phase), 3, 1, timeline));
}

}  // namespace
}  // namespace l4d
