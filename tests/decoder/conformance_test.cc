// SPDX-License-Identifier: Apache-2.0
// Profiles and levels of streams: what they ask for against what queries select, what they declare,
// and what the limits are.
#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "l4d/experimental/inspect.hpp"
#include "libl4dcodec/container/levels.h"
#include "tests/common/codec.h"
#include "tests/common/stream_editor.h"

namespace l4d {
namespace {

using namespace test;

l4d_stream_demand demand_of(const Bytes& file, uint64_t rate = 0, uint64_t burst = 0) {
  DecoderHandle d;
  d.open_memory(file.data(), file.size());
  return stream_demand(d, rate, burst);
}

class Streams : public testing::TestWithParam<NamedFile> {};
INSTANTIATE_TEST_SUITE_P(Conformance, Streams,
                         testing::Values(NamedFile{"dynamic", &dynamic_file},
                                         NamedFile{"staged", &staged_file},
                                         NamedFile{"rcq", &rcq_file},
                                         NamedFile{"lossless", &lossless_file},
                                         NamedFile{"tiny", &tiny_file}),
                         file_name);

// What queries select over the sequence never goes beyond the peak, and comes up to it.
TEST_P(Streams, PeakIsTheLargestQuery) {
  const Bytes& file = GetParam().bytes();
  const l4d_stream_demand c = demand_of(file);
  DecoderHandle d;
  d.open_memory(file.data(), file.size());
  const l4d_info info = d.info();
  uint64_t gaussians = 0, bytes = 0;
  const auto look = [&](double time) {
    const l4d_selection s = d.select(time_query(time));
    gaussians = std::max(gaussians, s.num_gaussians);
    bytes = std::max(bytes, s.bytes);
  };
  for (int k = 0; k <= 2000; ++k) look(info.timeline.time_begin + info.duration * k / 2000);
  // Just after the phase begins: the time of a phase itself is rounded.
  for (const double t : {c.instant_gaussians_time, c.instant_bytes_time})
    look(t + info.duration * 1e-9);
  EXPECT_EQ(gaussians, c.instant_gaussians);
  EXPECT_LE(bytes, c.instant_bytes);
  EXPECT_GT(bytes, c.instant_bytes / 2);
}

// A player that reads what a query needs and has not got yet never needs more than start, rate and
// burst bring.
TEST_P(Streams, ALinkOfTheMinBurstIsEnough) {
  const Bytes& file = GetParam().bytes();
  const uint64_t rate = file.size() / 4;
  const l4d_stream_demand c = demand_of(file, rate, 1000);
  DecoderHandle d;
  d.open_memory(file.data(), file.size());
  const l4d_info info = d.info();
  uint64_t bytes = 0;
  double worst = 0;
  for (int k = 0; k <= 200; ++k) {
    const double t = info.duration * k / 200;
    const l4d_selection s =
        d.select(range_query(info.timeline.time_begin, info.timeline.time_begin + t));
    bytes = s.bytes;
    worst = std::max(worst, static_cast<double>(bytes) -
                                static_cast<double>(c.start_bytes + c.min_burst_bytes) -
                                static_cast<double>(rate) * t);
  }
  EXPECT_LE(worst, 1);
  EXPECT_LE(bytes, file.size());
  EXPECT_LE(c.start_bytes, file.size());
  if (c.min_bytes_per_second != UINT64_MAX) {
    EXPECT_LE(demand_of(file, c.min_bytes_per_second).min_burst_bytes, 1000u);
  }
}

TEST_P(Streams, DeclareWhatTheyKeepTo) {
  const Bytes& file = GetParam().bytes();
  DecoderHandle d;
  d.open_memory(file.data(), file.size());
  const l4d_stream_demand c = demand_of(file);
  const bool lossless = std::string(GetParam().name) == "lossless";
  EXPECT_EQ(c.profile, uint32_t{lossless ? L4D_PROFILE_LOSSLESS : L4D_PROFILE_INDEXED});
  EXPECT_EQ(d.info().profile, c.profile);
  EXPECT_EQ(d.info().level, 1u);
  EXPECT_EQ(c.level, 1u);
  uint64_t violations = 99;
  EXPECT_EQ(l4d_decoder_check_conformance(d.get(), c.profile, 1, nullptr, nullptr, &violations),
            L4D_OK);
  EXPECT_EQ(violations, 0u);
  const uint32_t other = lossless ? L4D_PROFILE_MAIN : L4D_PROFILE_LOSSLESS;
  EXPECT_EQ(l4d_decoder_check_conformance(d.get(), other, 1, nullptr, nullptr, &violations),
            L4D_OK);
  EXPECT_EQ(violations, 1u);
  for (const uint32_t unknown : {7u, 255u}) {
    EXPECT_EQ(l4d_decoder_check_conformance(d.get(), unknown, 0, nullptr, nullptr, &violations),
              L4D_ERR_INVALID_ARGUMENT);
    EXPECT_EQ(l4d_decoder_check_conformance(d.get(), 0, unknown, nullptr, nullptr, &violations),
              L4D_ERR_INVALID_ARGUMENT);
  }
}

// Memory is charged before it is taken.
TEST(Conformance, MemoryIsLimited) {
  const Bytes& file = dynamic_file();
  const auto status = [&](uint64_t limit) {
    l4d_decoder_options options = decoder_options(L4D_BACKEND_AUTO, 1);
    options.max_memory_bytes = limit;
    DecoderHandle d(&options);
    d.open_memory(file.data(), file.size());
    l4d_stream_demand c = L4D_INIT(l4d_stream_demand);
    return l4d_decoder_get_stream_demand(d.get(), &c);
  };
  DecoderHandle d;
  d.open_memory(file.data(), file.size());
  l4d_counters before, after;
  before = L4D_INIT(l4d_counters);
  after = L4D_INIT(l4d_counters);
  d.check(l4d_decoder_get_counters(d.get(), &before));
  demand_of(file);
  l4d_stream_demand c = L4D_INIT(l4d_stream_demand);
  d.check(l4d_decoder_get_stream_demand(d.get(), &c));
  d.check(l4d_decoder_get_counters(d.get(), &after));
  ASSERT_GT(after.peak_memory_bytes, before.memory_bytes);
  EXPECT_EQ(after.pages_decoded, 0u);
  EXPECT_EQ(status(after.peak_memory_bytes), L4D_OK);
  EXPECT_EQ(status(after.peak_memory_bytes - 1), L4D_ERR_LIMIT_EXCEEDED);
}

TEST(Conformance, ADamagedDirectoryIsNoAnswer) {
  StreamEditor editor(dynamic_file());
  const auto place = editor.find([](const LayerHeader& l) { return !l.permanent; });
  editor.at(place).chunk.wrong_hash = true;
  const Bytes bytes = editor.build();
  DecoderHandle d;
  d.open_memory(bytes.data(), bytes.size());
  l4d_stream_demand c = L4D_INIT(l4d_stream_demand);
  EXPECT_EQ(l4d_decoder_get_stream_demand(d.get(), &c), L4D_ERR_CHECKSUM);
  // It is reported once, and does not count against the level.
  for (const Violation& v : validate(bytes))
    EXPECT_EQ(v.clause.rfind("LEVL", 0), std::string::npos);
}

// ---- limits ------------------------------------------------------------------------------------

TEST(Levels, LimitsGrow) {
  l4d_level_limits last{};
  for (uint32_t level = 1; level <= L4D_NUM_LEVELS; ++level) {
    l4d_level_limits l, lossless;
    l = L4D_INIT(l4d_level_limits);
    lossless = L4D_INIT(l4d_level_limits);
    ASSERT_EQ(l4d_get_level_limits(level, L4D_PROFILE_MAIN, &l), L4D_OK);
    ASSERT_EQ(l4d_get_level_limits(level, L4D_PROFILE_LOSSLESS, &lossless), L4D_OK);
    EXPECT_GT(l.instant_gaussians, last.instant_gaussians);
    EXPECT_GT(l.table_bytes, last.table_bytes);
    EXPECT_GT(l.instant_bytes, last.instant_bytes);
    EXPECT_GT(l.start_bytes, last.start_bytes);
    EXPECT_GT(l.bytes_per_second, last.bytes_per_second);
    EXPECT_GT(l.burst_bytes, last.burst_bytes);
    EXPECT_GT(l.memory_bytes, last.memory_bytes);
    // A scene of degree 3 that has all the Gaussians and tables of the level fits, coded or raw.
    EXPECT_LE(l.instant_gaussians * 65 * 4 + l.table_bytes, l.memory_bytes);
    EXPECT_LE(l.instant_gaussians * 65 * 4, lossless.instant_bytes);
    EXPECT_EQ(lossless.instant_gaussians, l.instant_gaussians);
    EXPECT_EQ(lossless.bytes_per_second, 8 * l.bytes_per_second);
    last = l;
  }
  EXPECT_EQ(l4d_get_level_limits(0, 0, &last), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_get_level_limits(7, 0, &last), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_get_level_limits(1, 4, &last), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_get_level_limits(1, 0, nullptr), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_STREQ(l4d_profile_name(L4D_PROFILE_MAIN), "main");
  EXPECT_EQ(l4d_profile_name(4), nullptr);
}

// spec: LEVL-1, LEVL-2
TEST(Levels, DeclarationsAreChecked) {
  const auto found = [](const Bytes& file, unsigned profile, unsigned level) {
    StreamEditor editor(file);
    editor.header.profile = profile;
    editor.header.conformance_level = level;
    const Bytes bytes = editor.build();
    // Decoders hand it on, whatever it is.
    EXPECT_GT(decode(bytes, all_query()).count(), 0u);
    std::string out;
    for (const Violation& v : validate(bytes)) {
      out += v.clause + (v.status == L4D_ERR_CORRUPT ? " " : "? ");
    }
    return out;
  };
  EXPECT_EQ(found(staged_file(), 0, 0), "");
  EXPECT_EQ(found(staged_file(), 1, 6), "");
  EXPECT_EQ(found(staged_file(), 2, 1), "");
  EXPECT_EQ(found(staged_file(), 3, 1), "LEVL-2 ");
  EXPECT_EQ(found(lossless_file(), 1, 1), "LEVL-2 ");
  EXPECT_EQ(found(lossless_file(), 2, 1), "LEVL-2 ");
  EXPECT_EQ(found(lossless_file(), 3, 1), "");
  EXPECT_EQ(found(lossless_file(), 4, 7), "LEVL-1? LEVL-1? ");
}

TEST(Levels, ProfilesSayWhatBreaksThem) {
  SceneHeader h;
  h.layers.resize(1);
  EXPECT_EQ(profile_of(h), ProfileId::kIndexed);
  EXPECT_EQ(profile_violation(h, ProfileId::kLossless), "position is not raw32");
  h.layers[0].mean_t = CoordinateCodingId::kFixed;
  EXPECT_EQ(profile_of(h), ProfileId::kMain);
  EXPECT_EQ(profile_violation(h, ProfileId::kIndexed), "mean_t of layer 0 is fixed");
  h.layers[0].mean_t = CoordinateCodingId::kF16;
  h.layers[0].component[L4D_COMPONENT_SCALE].coding = ComponentCodingId::kTransform;
  EXPECT_EQ(profile_of(h), ProfileId::kMain);
  EXPECT_EQ(profile_violation(h, ProfileId::kIndexed), "scale of layer 0 is a transform");
  h.layers[0].mean_t = CoordinateCodingId::kRaw32;
  EXPECT_EQ(profile_of(h), ProfileId::kNone);
  EXPECT_EQ(profile_violation(h, ProfileId::kMain), "mean_t of layer 0 is raw32");
}

}  // namespace
}  // namespace l4d
