// SPDX-License-Identifier: Apache-2.0
// No mean time is off by more than what the quality allows its Gaussian, however long the sequence
// and short the event.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "encoder/plan/mean_times.h"
#include "libl4dcodec/math/rotor.h"
#include "libl4dcodec/scene/layers.h"
#include "libl4dcodec/scene/slice.h"
#include "tests/common/codec.h"
#include "tests/common/random.h"

namespace l4d {
namespace {

using namespace test;

double sigma_of(const TestScene& s, size_t i) {
  double rotor[8], scale[4];
  for (size_t k = 0; k < 8; ++k) rotor[k] = static_cast<double>(s.rotor[8 * i + k]);
  for (size_t k = 0; k < 4; ++k) {
    scale[k] = std::exp(static_cast<double>(s.log_scale[4 * i + k]));
  }
  return 1 / std::sqrt(slice_gaussian(normalized_halves(rotor), scale).lambda);
}

// The largest error of a mean time, in temporal scales of its Gaussian.
double worst(const TestScene& scene, const Encoded& e) {
  const GaussianArrays a = decode(e.bytes, all_query());
  DecoderHandle d;
  d.open_memory(e.bytes.data(), e.bytes.size());
  double worst = 0;
  for (const l4d_bucket_span& r : a.spans) {
    l4d_layer_info layer = L4D_INIT(l4d_layer_info);
    d.check(l4d_decoder_get_layer_info(d.get(), r.layer, &layer));
    for (uint64_t k = r.first; k < r.first + r.count && layer.permanent == 0; ++k) {
      const size_t i = e.order[static_cast<size_t>(k)];
      const double mean = r.center + static_cast<double>(a.mean_t_local[static_cast<size_t>(k)]);
      EXPECT_EQ(mean, a.mean_t_double[static_cast<size_t>(k)]);
      const double want = scene.mean_t_double.empty() ? static_cast<double>(scene.mean_t[i])
                                                      : scene.mean_t_double[i];
      const double error = std::fabs(mean - want);
      worst = std::max(worst, error / sigma_of(scene, i));
    }
  }
  return worst;
}

EncodeOptions options_of(const char* preset) {
  EncodeOptions o;
  o.preset = preset;
  o.rans = true;
  o.settings.push_back({L4D_ENC_KMEANS_ITERATIONS, 1});
  return o;
}

constexpr struct {
  const char* preset;
  double bound;
} kBounds[] = {{"tiny", 0.125}, {"default", 0.05}, {"archive", 0.01}, {"indexed", 0.05}};

// Events from a twentieth of a frame to a tenth of the sequence in a room that stands still.
TestScene events(double seconds, uint32_t fps_num, uint32_t fps_den, double time_begin,
                 uint64_t seed) {
  SceneOptions o;
  o.count = 600;
  o.sh_degree = 0;
  o.num_frames = static_cast<uint32_t>(std::lround(seconds * fps_num / fps_den));
  o.fps_num = fps_num;
  o.fps_den = fps_den;
  o.time_begin = time_begin;
  o.seed = seed;
  TestScene s = make_scene(o);
  Random random(seed + 1000);
  const double shortest = std::log(0.05 * fps_den / fps_num);
  const double longest = std::log(0.1 * s.duration());
  for (size_t i = 0; i < s.count(); ++i) {
    if (i % 3 != 0) continue;
    s.mean_t[i] = static_cast<float>(time_begin + random.uniform(0, s.duration()));
    s.log_scale[4 * i + 3] = static_cast<float>(random.uniform(shortest, longest));
  }
  return s;
}

TEST(MeanTime, WithinTheBoundWhateverTheLength) {
  uint64_t seed = 1;
  for (const double seconds : {1.0, 10.0, 600.0, 3600.0, 86400.0}) {
    const bool ntsc = seed % 2 == 0;
    const TestScene scene =
        events(seconds, ntsc ? 60000 : 30, ntsc ? 1001 : 1, seed % 3 == 0 ? 7200 : 0, seed);
    for (const auto& b : kBounds) {
      const Encoded e = encode(scene, options_of(b.preset));
      EXPECT_LE(worst(scene, e), b.bound) << seconds << " s, " << b.preset;
      EXPECT_TRUE(validate(e.bytes).empty()) << seconds << " s, " << b.preset;
    }
    ++seed;
  }
}

// All events of one kind, few enough that their layer is merged to the coarsest.
TEST(MeanTime, FlashesStayWhereTheyAre) {
  for (const double seconds : {10.0, 600.0, 86400.0}) {
    for (const double sigma : {0.005, 0.03, 0.5}) {
      TestScene scene = events(seconds, 30, 1, 0, 77);
      for (size_t i = 0; i < scene.count(); i += 3) {
        scene.log_scale[4 * i + 3] = static_cast<float>(std::log(sigma));
      }
      const Encoded e = encode(scene, options_of("default"));
      EXPECT_LE(worst(scene, e), 0.05) << seconds << " s, " << sigma << " s";
    }
  }
}

// Codes that reach means far outside are too coarse for short events: those get layers apart.
TEST(MeanTime, FarMeansDoNotSpoilShortEvents) {
  TestScene scene = events(600, 30, 1, 0, 5);
  for (size_t i = 1; i < scene.count(); i += 3) {
    const double distance = scene.duration() * std::exp2(static_cast<double>(i % 14));
    scene.mean_t[i] = static_cast<float>(i % 2 == 0 ? distance : -distance);
    scene.log_scale[4 * i + 3] = static_cast<float>(std::min(std::log(distance / 3), 16.0));
  }
  for (const char* preset : {"default", "archive"}) {
    const Encoded e = encode(scene, options_of(preset));
    EXPECT_LE(worst(scene, e), preset[0] == 'd' ? 0.05 : 0.01);
    EXPECT_TRUE(validate(e.bytes).empty());
  }
}

// ---- binary64 ----------------------------------------------------------------------------------

// Events of 10 to 40 ms at times that binary32 does not hold: a day, counted from `begin`.
TestScene long_day(double begin) {
  TestScene s = events(86400, 60, 1, 0, 9);
  s.timeline.time_begin = begin;
  Random random(10);
  for (size_t i = 0; i < s.count(); ++i) {
    const bool event = i % 3 == 0;
    const double mean = event ? random.uniform(0, s.duration()) : static_cast<double>(s.mean_t[i]);
    s.mean_t_double.push_back(begin + mean);
    if (event) s.log_scale[4 * i + 3] = static_cast<float>(std::log(random.uniform(0.01, 0.04)));
  }
  s.mean_t.clear();
  s.mean_t.resize(s.mean_t_double.size(), -1.0f);  // not to be looked at
  return s;
}
constexpr double kBegins[] = {0, 1763800000.25};

TEST(DoubleTimes, LosslessIsExact) {
  for (const double begin : kBegins) {
    const TestScene scene = long_day(begin);
    EncodeOptions options;
    options.preset = "lossless";
    const Encoded e = encode(scene, options);
    EXPECT_TRUE(validate(e.bytes).empty());
    for (const uint32_t backend : {L4D_BACKEND_REFERENCE, L4D_BACKEND_CPU}) {
      const GaussianArrays a = decode(e.bytes, all_query(), backend);
      ASSERT_EQ(a.mean_t_double.size(), scene.count());
      for (size_t i = 0; i < a.count(); ++i) {
        ASSERT_EQ(a.mean_t_double[i], scene.mean_t_double[e.order[i]]);
        ASSERT_EQ(a.mean_t[i], static_cast<float>(a.mean_t_double[i]));
      }
    }
  }
}

// Every event is seen at its mean with its own opacity, and half as strong where it should be.
TEST(DoubleTimes, SlicesShowEventsWhenTheyAre) {
  for (const double begin : kBegins) {
    const TestScene scene = long_day(begin);
    for (const char* preset : {"lossless", "archive"}) {
      EncodeOptions options = options_of(preset);
      if (preset[0] == 'l') {
        options = EncodeOptions();
        options.preset = preset;
      }
      const Encoded e = encode(scene, options);
      const GaussianArrays a = decode(e.bytes, all_query());
      DecoderHandle d;
      d.open_memory(e.bytes.data(), e.bytes.size());
      for (size_t k = 0; k < a.count(); k += 7) {
        const size_t i = e.order[k];
        if (i % 3 != 0) continue;
        const double sigma = sigma_of(scene, i);
        for (const double away : {0.0, 1.1774}) {
          const double t = scene.mean_t_double[i] + away * sigma;
          const SplatArrays splats = d.slice(t);
          const double want = static_cast<double>(scene.opacity[i]) * std::exp(-0.5 * away * away);
          double nearest = 1;
          for (const float o : splats.opacity) {
            nearest = std::min(nearest, std::fabs(static_cast<double>(o) - want));
          }
          EXPECT_LE(nearest, preset[0] == 'l' ? 0.002 : 0.02) << preset << ", " << begin;
        }
      }
    }
  }
}

TEST(DoubleTimes, WithinTheBoundAtAnyTimeOfDay) {
  for (const double begin : kBegins) {
    const TestScene scene = long_day(begin);
    for (const auto& b : kBounds) {
      const Encoded e = encode(scene, options_of(b.preset));
      EXPECT_LE(worst(scene, e), b.bound) << b.preset << ", " << begin;
      EXPECT_TRUE(validate(e.bytes).empty());
    }
  }
}

// Times in binary32 that are given as binary64 are the same scene.
TEST(DoubleTimes, AreTheSameSceneAsFloatOnes) {
  TestScene scene = make_scene({});
  const Bytes want = encode(scene, options_of("default")).bytes;
  scene.mean_t_double.assign(scene.mean_t.begin(), scene.mean_t.end());
  EXPECT_TRUE(encode(scene, options_of("default")).bytes == want);
}

// What is fine enough for most is no reason to spend as many bits on all.
TEST(MeanTime, RefinesOnlyWhatNeedsIt) {
  std::vector<MeanTimeTarget> targets;
  Random random(3);
  for (int i = 0; i < 1000; ++i) {
    targets.push_back({random.uniform(-300, 300), i % 50 == 0 ? 0.001 : 5.0});
  }
  LayerHeader layer;
  choose_mean_times(targets, false, -1, 600, &layer);
  EXPECT_EQ(layer.mean_t, CoordinateCodingId::kFixed);
  EXPECT_TRUE(layer.mean_t_fine);
  EXPECT_LE(layer.mean_t_bits, 8u);
  int refined = 0;
  for (const MeanTimeTarget& t : targets) {
    const MeanTimeCode code = code_mean_time(layer, 600, t);
    EXPECT_TRUE(code.within);
    EXPECT_LE(std::fabs(static_cast<double>(code.local) - t.local), t.tolerance);
    refined += code.fine != 0;
  }
  EXPECT_LE(refined, 200);
  for (MeanTimeTarget& t : targets) t.tolerance = 5;
  choose_mean_times(targets, false, -1, 600, &layer);
  EXPECT_FALSE(layer.mean_t_fine);
}

// spec: DEC-1
TEST(MeanTime, CellsOfARefinement) {
  EXPECT_EQ(fixed_mean_time(0.25f, 3, 7, 0), 1.0f);
  EXPECT_EQ(fixed_mean_time(0.25f, 3, 1, 0), -0.5f);
  // One bit: halves of the step. Two: quarters.
  EXPECT_EQ(fixed_mean_time(1, 0, 5, 1), 4.75f);
  EXPECT_EQ(fixed_mean_time(1, 0, 5, 2), 5.25f);
  EXPECT_EQ(fixed_mean_time(1, 0, 5, 3), 4.625f);
  EXPECT_EQ(fixed_mean_time(1, 0, 5, 6), 5.375f);
  EXPECT_EQ(fixed_mean_time(1, 0, 0, 65535), -0.5f + 0x1p-17f);
  for (unsigned bits = 1; bits < 16; ++bits) {
    double sum = 0;
    for (unsigned r = 1u << bits; r < 2u << bits; ++r) {
      sum += static_cast<double>(fixed_mean_time(1, 0, 0, static_cast<uint16_t>(r - 1)));
    }
    EXPECT_EQ(sum, 0) << bits;  // cells lie about the middle
  }
}

}  // namespace
}  // namespace l4d
