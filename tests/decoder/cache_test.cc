// SPDX-License-Identifier: Apache-2.0
// Stepping through time: each bucket is decoded once, nothing is forgotten, memory stays bounded.
#include <gtest/gtest.h>

#include <set>

#include "tests/common/codec.h"
#include "tests/common/random.h"
#include "tests/decoder/allocation_meter.h"

namespace l4d {
namespace {

using namespace test;

l4d_counters counters(const DecoderHandle& d) {
  l4d_counters c = L4D_INIT(l4d_counters);
  d.check(l4d_decoder_get_counters(d.get(), &c));
  return c;
}

SplatArrays fresh_slice(const Bytes& bytes, double t) {
  const l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
  DecoderHandle d(&o);
  d.open_memory(bytes.data(), bytes.size());
  return d.slice(t);
}

std::vector<double> frames(const Bytes& bytes, uint32_t step) {
  DecoderHandle d;
  d.open_memory(bytes.data(), bytes.size());
  const l4d_timeline t = d.info().timeline;
  std::vector<double> times;
  for (uint32_t k = 0; k < t.num_frames; k += step) {
    times.push_back(t.time_begin + static_cast<double>(k) * t.fps_den / t.fps_num);
  }
  return times;
}

class Cache : public testing::TestWithParam<NamedFile> {};

TEST_P(Cache, SteppingShowsWhatAFreshDecoderShows) {
  const Bytes& bytes = GetParam().bytes();
  const l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
  DecoderHandle d(&o);
  d.open_memory(bytes.data(), bytes.size());
  for (const double t : frames(bytes, 3)) {
    const SplatArrays want = fresh_slice(bytes, t);
    const SplatArrays got = d.slice(t);
    EXPECT_EQ(want.count(), got.count()) << "time " << t;
    ASSERT_TRUE(same_bits(want, got)) << "time " << t;
  }
}

TEST_P(Cache, JumpingShowsWhatAFreshDecoderShows) {
  const Bytes& bytes = GetParam().bytes();
  const auto times = frames(bytes, 1);
  Random random(12);
  for (const uint64_t cache_bytes : {uint64_t{1}, uint64_t{200000}, uint64_t{0}}) {
    l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
    o.cache_bytes = cache_bytes;
    DecoderHandle d(&o);
    d.open_memory(bytes.data(), bytes.size());
    for (int i = 0; i < 12; ++i) {
      const double t = times[random.below(static_cast<uint32_t>(times.size()))];
      ASSERT_TRUE(same_bits(fresh_slice(bytes, t), d.slice(t)))
          << "time " << t << ", cache of " << cache_bytes;
    }
  }
}

TEST_P(Cache, SteppingDecodesEachBucketOnce) {
  const Bytes& bytes = GetParam().bytes();
  const l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
  DecoderHandle d(&o), other(&o);
  d.open_memory(bytes.data(), bytes.size());
  other.open_memory(bytes.data(), bytes.size());
  std::set<std::pair<uint32_t, uint32_t>> buckets;
  uint64_t uses = 0;
  l4d_splat_buffers b = L4D_INIT(l4d_splat_buffers);
  for (const double t : frames(bytes, 1)) {
    ASSERT_EQ(l4d_decoder_slice(d.get(), t, &b), L4D_OK);
    const GaussianArrays a = other.decode(time_query(t));
    for (const l4d_bucket_span& r : a.spans) buckets.emplace(r.layer, r.bucket);
    uses += a.spans.size();
  }
  const l4d_counters c = counters(d);
  EXPECT_EQ(c.buckets_decoded, buckets.size());
  EXPECT_EQ(c.cache_hits, uses - buckets.size());
}

INSTANTIATE_TEST_SUITE_P(Streams, Cache,
                         testing::Values(NamedFile{"dynamic", dynamic_file},
                                         NamedFile{"rcq", rcq_file},
                                         NamedFile{"transform", transform_file},
                                         NamedFile{"lossless", lossless_file},
                                         NamedFile{"wandering", wandering_file}),
                         file_name);

using Buckets = std::set<std::pair<uint32_t, uint32_t>>;  // layer, bucket

// What an instant needs, by the directory.
Buckets buckets_at(const Bytes& bytes, double t) {
  DecoderHandle d;
  d.open_memory(bytes.data(), bytes.size());
  l4d_query q = time_query(t);
  q.whole_buckets = 1;
  Buckets out;
  for (const l4d_bucket_span& r : d.decode(q).spans) out.emplace(r.layer, r.bucket);
  return out;
}

Buckets without(const Buckets& a, const Buckets& b) {
  Buckets out;
  for (const auto& bucket : a) {
    if (b.count(bucket) == 0) out.insert(bucket);
  }
  return out;
}

// Slices on a decoder that has codebooks and directory pages already: what it holds beyond them is
// buckets.
struct Player {
  explicit Player(const Bytes& bytes, uint64_t cache_bytes) {
    l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
    o.cache_bytes = cache_bytes;
    d = DecoderHandle(&o);
    d.open_memory(bytes.data(), bytes.size());
    d.decode(all_query());
    tables = counters(d).memory_bytes;
  }
  // Buckets that had to be decoded.
  uint64_t show(double t) {
    const uint64_t before = counters(d).buckets_decoded;
    l4d_splat_buffers b = L4D_INIT(l4d_splat_buffers);
    EXPECT_EQ(l4d_decoder_slice(d.get(), t, &b), L4D_OK);
    return counters(d).buckets_decoded - before;
  }
  uint64_t held() const { return counters(d).memory_bytes - tables; }
  DecoderHandle d;
  uint64_t tables = 0;
};

// What a decoder keeps of its plans, which grows with the largest one: less than any bucket takes.
constexpr uint64_t kMostPlan = 2048;

// With room for nothing, the cache holds the buckets of the instant that is shown and no other.
TEST(CacheBudget, ATinyCacheHoldsTheInstantAlone) {
  const Bytes& bytes = dynamic_file();
  Player tiny(bytes, 1), roomy(bytes, 0);
  Buckets kept, ever;
  size_t again = 0;
  for (const double t : frames(bytes, 3)) {
    const Buckets now = buckets_at(bytes, t);
    SCOPED_TRACE("time " + std::to_string(t));
    const size_t wanted = without(now, kept).size();
    EXPECT_EQ(tiny.show(t), wanted);
    EXPECT_EQ(roomy.show(t), without(now, ever).size());
    Player fresh(bytes, 0);
    EXPECT_EQ(fresh.show(t), now.size());
    // What is not needed any more goes when room is wanted.
    if (wanted > 0) {
      kept = now;
      EXPECT_GE(tiny.held(), fresh.held());
      EXPECT_LT(tiny.held(), fresh.held() + kMostPlan);
    }
    again += wanted - without(now, ever).size();
    ever.insert(now.begin(), now.end());
  }
  // Back to the beginning, so that what was given up is wanted again.
  again += tiny.show(0);
  EXPECT_GT(again, 0u);
  EXPECT_EQ(roomy.show(0), 0u);
  EXPECT_LT(tiny.held(), roomy.held());
}

// What was used least recently goes first: of instants shown in the order A, B, A, C, nothing of A
// goes before all of B that the others do not use.
TEST(CacheBudget, TheLeastRecentlyUsedGoesFirst) {
  const Bytes& bytes = dynamic_file();
  const double a = 0.05, b = 0.75, c = 1.45;
  const Buckets of_a = buckets_at(bytes, a), of_b = buckets_at(bytes, b),
                of_c = buckets_at(bytes, c);
  const size_t only_a = without(without(of_a, of_b), of_c).size();
  const size_t only_b = without(without(of_b, of_a), of_c).size();
  ASSERT_GT(only_a, 1u);
  ASSERT_GT(only_b, 1u);
  ASSERT_GT(without(without(of_c, of_a), of_b).size(), 1u);
  Player all(bytes, 0);
  for (const double t : {a, b, c}) all.show(t);
  const uint64_t most = all.held();
  size_t parted = 0;  // budgets at which A is kept and B is not
  for (int k = 1; k <= 128; ++k) {
    const uint64_t budget = most * static_cast<uint64_t>(k) / 128;
    const auto missing = [&](double last) {
      Player p(bytes, budget);
      for (const double t : {a, b, a, c}) p.show(t);
      return p.show(last);
    };
    const uint64_t of_newer = missing(a), of_older = missing(b);
    SCOPED_TRACE("cache of " + std::to_string(budget) + " bytes");
    EXPECT_LE(of_older, only_b + of_newer);
    if (of_newer > 0) {
      EXPECT_GE(of_older, only_b);  // nothing of B alone is left
    }
    parted += of_newer == 0 && of_older > 0;
  }
  EXPECT_GE(parted, 3u);
}

TEST(CacheBudget, ReopeningForgetsTheOldStream) {
  const l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
  DecoderHandle d(&o);
  d.open_memory(dynamic_file().data(), dynamic_file().size());
  d.slice(1.0);
  d.open_memory(lossless_file().data(), lossless_file().size());
  EXPECT_TRUE(same_bits(fresh_slice(lossless_file(), 1.0), d.slice(1.0)));
  // Counters are of the stream that is open.
  DecoderHandle once(&o);
  once.open_memory(lossless_file().data(), lossless_file().size());
  once.slice(1.0);
  const l4d_counters a = counters(d), b = counters(once);
  EXPECT_EQ(a.reads, b.reads);
  EXPECT_EQ(a.bytes_read, b.bytes_read);
  EXPECT_EQ(a.pages_decoded, b.pages_decoded);
  EXPECT_EQ(a.buckets_decoded, b.buckets_decoded);
  EXPECT_EQ(a.cache_hits, b.cache_hits);
  EXPECT_EQ(a.memory_bytes, b.memory_bytes);
}

// Whatever the limit: the right answer, or LIMIT_EXCEEDED and a handle that still works.
TEST(MemoryLimit, IsHonouredAtEveryValue) {
  const SplatArrays want_slice = fresh_slice(dynamic_file(), 1.0);
  const GaussianArrays want = decode(dynamic_file(), all_query());
  bool refused = false, done = false;
  for (uint64_t limit = 256; limit < (uint64_t{1} << 26); limit += limit / 3) {
    l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
    o.max_memory_bytes = limit;
    DecoderHandle d(&o);
    const l4d_status opened =
        l4d_decoder_open_memory(d.get(), dynamic_file().data(), dynamic_file().size());
    if (opened != L4D_OK) {
      ASSERT_EQ(opened, L4D_ERR_LIMIT_EXCEEDED) << limit;
      EXPECT_STRNE(l4d_last_error_message(), "");
      refused = true;
      continue;
    }
    try {
      ASSERT_TRUE(same_bits(d.decode(all_query()), want));
      ASSERT_TRUE(same_bits(d.slice(1.0), want_slice));
      done = true;
    } catch (const Error& e) {
      ASSERT_EQ(e.status(), L4D_ERR_LIMIT_EXCEEDED) << limit << ": " << e.what();
      refused = true;
      ASSERT_FALSE(done) << "a higher limit refuses what a lower one allowed";
    }
    ASSERT_LE(counters(d).peak_memory_bytes, limit);
    ASSERT_LE(counters(d).memory_bytes, counters(d).peak_memory_bytes);
  }
  EXPECT_TRUE(refused);
  EXPECT_TRUE(done);
}

// The cache is the library's own and gives way before the limit refuses a stream that fits it.
TEST(MemoryLimit, CacheGivesWayToIt) {
  const Bytes& bytes = dynamic_file();
  l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
  uint64_t largest_alone = 0;  // most that a single instant needs
  uint64_t all_together = 0;
  for (const double t : frames(bytes, 5)) {
    DecoderHandle d(&o);
    d.open_memory(bytes.data(), bytes.size());
    d.slice(t);
    largest_alone = std::max(largest_alone, counters(d).peak_memory_bytes);
  }
  {
    DecoderHandle d(&o);
    d.open_memory(bytes.data(), bytes.size());
    for (const double t : frames(bytes, 5)) d.slice(t);
    all_together = counters(d).peak_memory_bytes;
  }
  ASSERT_GT(all_together, largest_alone + largest_alone / 16);
  // Room for any instant, and for the codebooks and directory pages of all.
  o.max_memory_bytes = largest_alone + (all_together - largest_alone) / 2;
  DecoderHandle d(&o);
  d.open_memory(bytes.data(), bytes.size());
  l4d_splat_buffers b = L4D_INIT(l4d_splat_buffers);
  for (const double t : frames(bytes, 5)) {
    ASSERT_EQ(l4d_decoder_slice(d.get(), t, &b), L4D_OK)
        << "time " << t << ": " << l4d_last_error_message();
  }
}

TEST(MemoryLimit, CountsWhatIsAllocated) {
  const Bytes& bytes = rcq_file();
  const l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
  const l4d_query q = all_query();
  std::vector<float> sh(3 * 24000), rotor(8 * 24000), scale(4 * 24000);
  const AllocationMeter meter;
  DecoderHandle d(&o);
  d.open_memory(bytes.data(), bytes.size());
  l4d_gaussian_buffers b = L4D_INIT(l4d_gaussian_buffers);
  b.capacity = 24000;
  b.sh = sh.data();
  b.rotor = rotor.data();
  b.log_scale = scale.data();
  ASSERT_EQ(l4d_decoder_decode(d.get(), &q, &b), L4D_OK);
  // Working memory of one page per thread is not charged; it does not grow with the stream.
  constexpr uint64_t kPerThread = 2u << 20;
  EXPECT_LE(meter.peak(), counters(d).peak_memory_bytes + kPerThread);
}

TEST(StreamLimits, GaussiansAndFrames) {
  const l4d_info info = [] {
    DecoderHandle d;
    d.open_memory(dynamic_file().data(), dynamic_file().size());
    return d.info();
  }();
  l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
  const auto open = [&] {
    DecoderHandle d(&o);
    return l4d_decoder_open_memory(d.get(), dynamic_file().data(), dynamic_file().size());
  };
  o.max_gaussians = info.num_gaussians;
  o.max_frames = info.timeline.num_frames;
  EXPECT_EQ(open(), L4D_OK);
  o.max_gaussians = info.num_gaussians - 1;
  EXPECT_EQ(open(), L4D_ERR_LIMIT_EXCEEDED);
  o.max_gaussians = 0;
  o.max_frames = info.timeline.num_frames - 1;
  EXPECT_EQ(open(), L4D_ERR_LIMIT_EXCEEDED);
}

TEST(Progress, CancelsAndLeavesTheHandleUsable) {
  const l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
  DecoderHandle d(&o);
  d.open_memory(dynamic_file().data(), dynamic_file().size());
  struct State {
    int calls = 0;
    int cancel_at = -1;
    uint64_t last_done = 0, total = 0;
  } state;
  const auto progress = [](void* user, uint64_t done, uint64_t total, const char* stage) -> int {
    State& s = *static_cast<State*>(user);
    EXPECT_STREQ(stage, "decode");
    EXPECT_LE(done, total);
    s.last_done = done;
    s.total = total;
    return s.calls++ == s.cancel_at ? 1 : 0;
  };
  ASSERT_EQ(l4d_decoder_set_progress(d.get(), progress, &state), L4D_OK);
  const GaussianArrays want = d.decode(all_query());
  ASSERT_GT(state.calls, 0);
  EXPECT_EQ(state.last_done, state.total);
  const int calls = state.calls;
  for (int k = 0; k < calls; ++k) {
    state.calls = 0;
    state.cancel_at = k;
    try {
      d.decode(all_query());
      ADD_FAILURE() << "not cancelled at call " << k;
    } catch (const Error& e) {
      EXPECT_EQ(e.status(), L4D_ERR_CANCELLED);
    }
  }
  state.calls = 0;
  state.cancel_at = 0;
  l4d_splat_buffers b = L4D_INIT(l4d_splat_buffers);
  EXPECT_EQ(l4d_decoder_slice(d.get(), 1.0, &b), L4D_ERR_CANCELLED);
  state.cancel_at = -1;
  EXPECT_TRUE(same_bits(want, d.decode(all_query())));
  EXPECT_TRUE(same_bits(fresh_slice(dynamic_file(), 1.0), d.slice(1.0)));
  ASSERT_EQ(l4d_decoder_set_progress(d.get(), nullptr, nullptr), L4D_OK);
  state.calls = 0;
  d.decode(all_query());
  EXPECT_EQ(state.calls, 0);
}

}  // namespace
}  // namespace l4d
