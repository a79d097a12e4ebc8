// SPDX-License-Identifier: Apache-2.0
// What holds for every scene and every setting.
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "libl4dcodec/scene/layers.h"
#include "tests/common/codec.h"
#include "tests/common/random.h"
#include "tests/decoder/rows.h"
#include "tests/numerics/arbitrary_scene.h"

namespace l4d::numerics {
namespace {

using namespace test;

// A stream, open, with all its Gaussians.
struct Opened {
  explicit Opened(const Bytes& from) : bytes(from) {
    decoder.open_memory(bytes.data(), bytes.size());
    info = decoder.info();
    all = decoder.decode(all_query());
    seen = visibility(decoder, all);
  }
  double begin() const { return info.timeline.time_begin; }
  double end() const { return begin() + info.duration; }

  const Bytes& bytes;
  const l4d_decoder_options options = decoder_options(L4D_BACKEND_AUTO, 1);
  DecoderHandle decoder{&options};
  l4d_info info{};
  GaussianArrays all;
  Visibility seen;
};

// Frames, borders of buckets with their neighbours, and times between.
double draw_time(const Opened& s) {
  const int kind = *rc::gen::inRange(0, 4);
  const int place = *rc::gen::inRange(0, 1 << 20);
  const double share = place / static_cast<double>(1 << 20);
  double t = s.begin() + share * s.info.duration;
  if (kind == 1) {
    t = s.begin() + std::floor(share * s.info.timeline.num_frames) * s.info.timeline.fps_den /
                        s.info.timeline.fps_num;
  }
  if (kind >= 2) {
    const int buckets = 4 << *rc::gen::inRange(0, 6);
    t = s.begin() + s.info.duration * std::floor(share * (buckets + 1)) / buckets;
    if (kind == 3) t = std::nextafter(t, place % 2 == 0 ? -HUGE_VAL : HUGE_VAL);
  }
  return std::clamp(t, s.begin(), s.end());
}

// Rows visible at t, in decoded order.
Rows visible_in_order(const DecoderHandle& d, const GaussianArrays& a, double t) {
  const Visibility v = visibility(d, a);
  Rows out;
  for (size_t i = 0; i < a.count(); ++i) {
    if (v.visible(i, t)) out.push_back(row(a, i));
  }
  return out;
}

TEST(Property, VisibleGaussiansAreInNeighbouringBuckets) {
  EXPECT_TRUE(rc::check("VisibleGaussiansAreInNeighbouringBuckets", [] {
    const Encoded e = [] {
      const ArbitraryScene s = draw_scene(true);
      return encode(s.make(), s.encode);
    }();
    const Opened s(e.bytes);
    for (int k = 0; k < 10; ++k) {
      const double t = draw_time(s);
      for (const l4d_bucket_span& r : s.all.spans) {
        const uint32_t now = bucket_of_time(s.info.timeline, t, r.level);
        for (size_t i = r.first; i < r.first + r.count; ++i) {
          if (s.seen.visible(i, t)) RC_ASSERT(same_or_neighbour(now, r.bucket));
        }
      }
    }
    for (const l4d_bucket_span& r : s.all.spans) {
      for (size_t i = r.first; i < r.first + r.count; ++i) {
        if (s.seen.permanent[i]) continue;
        const double sigma = 1 / std::sqrt(s.seen.lambda[i]);
        RC_ASSERT(fits_layer(s.seen.mean[i], sigma, r.bucket, r.level, s.info.timeline));
      }
    }
    RC_ASSERT(validate(e.bytes).empty());
  }));
}

// The gate decides what is shown, not what was loaded: all buckets, those of a range, those of the
// instant.
TEST(Property, AnySupersetOfBucketsGivesTheSameSlice) {
  EXPECT_TRUE(rc::check("AnySupersetOfBucketsGivesTheSameSlice", [] {
    const ArbitraryScene drawn = draw_scene(true);
    const Encoded e = encode(drawn.make(), drawn.encode);
    const Opened s(e.bytes);
    for (int k = 0; k < 6; ++k) {
      const double t = draw_time(s), a = draw_time(s), b = draw_time(s);
      const Rows want = visible_in_order(s.decoder, s.all, t);
      const GaussianArrays now = s.decoder.decode(time_query(t));
      const GaussianArrays range =
          s.decoder.decode(range_query(std::min({a, b, t}), std::max({a, b, t})));
      RC_ASSERT(visible_in_order(s.decoder, now, t) == want);
      RC_ASSERT(visible_in_order(s.decoder, range, t) == want);
      // The slicer's own gate is in binary32: at most Gaussians at the gate are judged otherwise.
      const size_t shown = s.decoder.slice(t).count();
      size_t surely = 0, perhaps = 0;
      for (size_t i = 0; i < s.all.count(); ++i) {
        const double dt = t - s.seen.mean[i];
        const double x = s.seen.permanent[i] ? 0 : s.seen.lambda[i] * dt * dt;
        surely += x <= 16 * (1 - 1e-5);
        perhaps += x <= 16 * (1 + 1e-5);
      }
      RC_ASSERT(shown >= surely);
      RC_ASSERT(shown <= perhaps);
    }
  }));
}

TEST(Property, OrderOfQueriesThreadsAndBackendsDoNotMatter) {
  EXPECT_TRUE(rc::check("OrderOfQueriesThreadsAndBackendsDoNotMatter", [] {
    const ArbitraryScene drawn = draw_scene(true);
    const TestScene scene = drawn.make();
    const Encoded e = encode(scene, drawn.encode);
    EncodeOptions threaded = drawn.encode;
    threaded.threads = static_cast<uint32_t>(*rc::gen::inRange(2, 8));
    RC_ASSERT(encode(scene, threaded).bytes == e.bytes);
    const Opened s(e.bytes);
    RC_ASSERT(bool(same_bits(s.all, decode(e.bytes, all_query(), L4D_BACKEND_REFERENCE, 1))));
    RC_ASSERT(
        bool(same_bits(s.all, decode(e.bytes, all_query(), L4D_BACKEND_CPU, threaded.threads))));
    std::vector<double> times;
    for (int k = 0; k < 5; ++k) times.push_back(draw_time(s));
    for (const double t : times) s.decoder.slice(t);  // fills the cache in this order
    const l4d_decoder_options other = decoder_options(L4D_BACKEND_REFERENCE, threaded.threads);
    for (size_t k = times.size(); k-- > 0;) {
      DecoderHandle fresh(&other);
      fresh.open_memory(e.bytes.data(), e.bytes.size());
      RC_ASSERT(bool(same_bits(s.decoder.slice(times[k]), fresh.slice(times[k]))));
    }
  }));
}

// Any finite bits, not just those of scenes.
void scramble(TestScene& scene, uint64_t seed) {
  Random random(seed);
  const auto odd = [&](std::vector<float>& v, double most) {
    for (float& x : v) {
      if (random.below(8) != 0) continue;
      const uint32_t bits = static_cast<uint32_t>(random.bits());
      float y;
      std::memcpy(&y, &bits, sizeof y);
      if (std::fabs(static_cast<double>(y)) <= most) x = y;
      if (random.below(4) == 0) x = -0.0f;
      if (random.below(4) == 0) x = std::numeric_limits<float>::denorm_min();
    }
  };
  odd(scene.position, 1e18);
  odd(scene.mean_t, 1e18);
  odd(scene.log_scale, 16);
  odd(scene.rotor, 1e15);
  odd(scene.sh, 65504);
}

TEST(Property, LosslessIsLossless) {
  EXPECT_TRUE(rc::check("LosslessIsLossless", [] {
    const ArbitraryScene drawn = draw_scene(false);
    TestScene scene = drawn.make();
    scramble(scene, static_cast<uint64_t>(*rc::gen::inRange(0, 1000)));
    const Encoded e = encode(scene, drawn.encode);
    const GaussianArrays a = decode(e.bytes, all_query());
    RC_ASSERT(a.count() == scene.count());
    RC_ASSERT(a.flags == scene.flags);
    const auto same = [&](const std::vector<float>& got, const std::vector<float>& given,
                          size_t dim) {
      for (size_t i = 0; i < a.count(); ++i) {
        if (std::memcmp(got.data() + dim * i, given.data() + dim * e.order[i],
                        dim * sizeof(float)) != 0) {
          return false;
        }
      }
      return true;
    };
    RC_ASSERT(same(a.position, scene.position, 3));
    RC_ASSERT(same(a.mean_t, scene.mean_t, 1));
    RC_ASSERT(same(a.log_scale, scene.log_scale, 4));
    RC_ASSERT(same(a.rotor, scene.rotor, 8));
    RC_ASSERT(same(a.opacity, scene.opacity, 1));
    RC_ASSERT(same(a.sh, scene.sh, scene.sh_dim()));
  }));
}

}  // namespace
}  // namespace l4d::numerics
