// SPDX-License-Identifier: Apache-2.0
// Readers whose reads cost more than bytes (l4d_reader.block_bytes): few reads, the same bits, and
// nothing that fails where a plain reader would not.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <functional>
#include <string>
#include <vector>

#include "tests/common/codec.h"
#include "tests/common/sh_detail.h"

namespace l4d {
namespace {

using namespace test;

// A file at the end of a network.
struct Network {
  explicit Network(const Bytes& of, uint64_t block) : file(of), block_bytes(block) {}

  const Bytes& file;
  uint64_t block_bytes;
  bool many = true;
  size_t reads = 0, batches = 0;
  uint64_t bytes = 0;
  std::function<bool(uint64_t offset, unsigned char* to, size_t n)> fault;  // true: fails

  int64_t read(void* dst, size_t n, uint64_t offset) {
    ++reads;
    bytes += n;
    auto* to = static_cast<unsigned char*>(dst);
    std::copy_n(file.data() + offset, n, to);
    return fault && fault(offset, to, n) ? -1 : static_cast<int64_t>(n);
  }
  l4d_reader reader() {
    l4d_reader r = L4D_INIT(l4d_reader);
    r.user = this;
    r.block_bytes = block_bytes;
    r.size = [](void* user) {
      return static_cast<int64_t>(static_cast<Network*>(user)->file.size());
    };
    r.read_at = [](void* user, void* dst, size_t n, uint64_t offset) {
      return static_cast<Network*>(user)->read(dst, n, offset);
    };
    if (!many) return r;
    r.read_many = [](void* user, const l4d_read* all, size_t count) {
      auto& self = *static_cast<Network*>(user);
      ++self.batches;
      for (size_t i = count; i-- > 0;) {  // in any order
        if (self.read(all[i].dst, all[i].size, all[i].offset) < 0) return 1;
      }
      return 0;
    };
    return r;
  }
};

DecoderHandle opened(Network& network, uint64_t max_memory = 0, bool tolerant = false) {
  l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
  o.max_memory_bytes = max_memory;
  o.tolerant = tolerant;
  DecoderHandle d(&o);
  d.open(network.reader());
  return d;
}

SplatArrays plain_slice(const Bytes& file, double time, uint32_t detail = L4D_DETAIL_FULL) {
  DecoderHandle d;
  d.open_memory(file.data(), file.size());
  return d.slice(time, {{0, 0, detail, 0}});
}

// A minute in all temporal levels, with directory pages of few buckets.
const Bytes& minute_file() {
  static const Bytes kBytes = [] {
    SceneOptions scene;
    scene.count = 20000;
    scene.num_frames = 1800;
    scene.sh_degree = 2;
    EncodeOptions o;
    o.preset = "default";
    o.settings = {{L4D_ENC_MERGE_COUNT, 40}, {L4D_ENC_PAGE_SIZE, 128}};
    return encode(make_scene(scene), o).bytes;
  }();
  return kBytes;
}

const Bytes& split_file() {
  static const Bytes kBytes = with_sh_detail(transform_file(), 1);
  return kBytes;
}

size_t num_losses(const DecoderHandle& d) {
  uint64_t count = 0;
  d.check(l4d_decoder_get_losses(d.get(), nullptr, 0, &count));
  return static_cast<size_t>(count);
}

class ReadAheadStreams : public testing::TestWithParam<NamedFile> {};

// A step of playback or a seek, and what a plain reader shows there.
struct Step {
  double time;
  uint32_t detail;
  SplatArrays want;
};

TEST_P(ReadAheadStreams, SameBits) {
  const Bytes& file = GetParam().bytes();
  const GaussianArrays want = decode(file, all_query()),
                       want_instant = decode(file, time_query(0.3));
  std::vector<Step> steps;
  for (const double t : {0.0, 0.3, 0.6, 0.9, 1.9, 0.1, 1.45, 1.9}) {
    steps.push_back({t, L4D_DETAIL_FULL, plain_slice(file, t)});
  }
  for (const double t : {0.2, 0.4, 1.7}) {
    steps.push_back({t, L4D_DETAIL_BASE_COLOR, plain_slice(file, t, L4D_DETAIL_BASE_COLOR)});
  }
  steps.push_back({0.4, L4D_DETAIL_FULL, plain_slice(file, 0.4)});
  for (const uint64_t block : {uint64_t{1}, uint64_t{700}, uint64_t{65536}, UINT64_MAX}) {
    SCOPED_TRACE("blocks of " + std::to_string(block));
    Network network(file, block);
    network.many = block != 700;
    DecoderHandle d = opened(network);
    EXPECT_TRUE(same_bits(want_instant, d.decode(time_query(0.3))));
    for (const Step& step : steps) {
      EXPECT_TRUE(same_bits(step.want, d.slice(step.time, {{0, 0, step.detail, 0}}))) << step.time;
    }
    EXPECT_TRUE(same_bits(want, d.decode(all_query())));
  }
}

INSTANTIATE_TEST_SUITE_P(
    Streams, ReadAheadStreams,
    testing::Values(NamedFile{"indexed", dynamic_file}, NamedFile{"staged", staged_file},
                    NamedFile{"rcq", rcq_file}, NamedFile{"transform", transform_file},
                    NamedFile{"lossless", lossless_file}, NamedFile{"wandering", wandering_file},
                    NamedFile{"tiny", tiny_file}),
    file_name);

constexpr double kFrame = 1.0 / 30;

TEST(ReadAhead, FirstPictureAndPlayTakeFewReads) {
  for (const double begin : {0.0, 30.0}) {
    Network network(minute_file(), 65536), plain(minute_file(), 0);
    DecoderHandle d = opened(network), exact = opened(plain);
    (void)d.slice(begin);
    (void)exact.slice(begin);
    EXPECT_LE(network.reads, 6u);
    EXPECT_GT(plain.reads, 20u);
    network.reads = plain.reads = 0;
    size_t waits = 0;
    for (int frame = 1; frame <= 300; ++frame) {
      const size_t before = network.reads;
      (void)d.slice(begin + frame * kFrame);
      (void)exact.slice(begin + frame * kFrame);
      waits += network.reads != before;
    }
    EXPECT_LE(network.reads, 20u) << "in ten seconds";
    EXPECT_LE(waits, 11u);
    EXPECT_GT(plain.reads, 30u);
  }
}

TEST(ReadAhead, SeeksTakeFewReads) {
  Network network(minute_file(), 4096), plain(minute_file(), 0);
  DecoderHandle d = opened(network), exact = opened(plain);
  (void)d.slice(0);
  (void)exact.slice(0);
  network.reads = plain.reads = 0;
  constexpr int kSeeks = 12;
  for (int i = 0; i < kSeeks; ++i) {
    const double t = 4.7 * ((7 * i) % kSeeks) + 2;
    EXPECT_TRUE(same_bits(exact.slice(t), d.slice(t))) << t;
  }
  EXPECT_LE(network.reads, plain.reads / 2);
  EXPECT_LE(network.reads, 6u * kSeeks);
}

// Where gaps are worth nothing, little is read that is not needed.
TEST(ReadAhead, ReadsNoMoreThanIsNeeded) {
  Network network(minute_file(), 1), plain(minute_file(), 0);
  DecoderHandle d = opened(network), exact = opened(plain);
  for (const double t : {3.0, 31.0, 58.0}) {
    (void)d.slice(t);
    (void)exact.slice(t);
  }
  EXPECT_LE(static_cast<double>(network.bytes), 1.05 * static_cast<double>(plain.bytes));
}

// spec: DEC-3
TEST(ReadAhead, MoreDetailReadsShChunksOnly) {
  for (const uint64_t block : {uint64_t{0}, uint64_t{1}}) {
    Network network(split_file(), block);
    DecoderHandle d = opened(network);
    (void)d.slice(0.7, {{0, 0, L4D_DETAIL_BASE_COLOR, 0}});
    const uint64_t base = network.bytes;
    EXPECT_TRUE(same_bits(plain_slice(split_file(), 0.7), d.slice(0.7)));
    const uint64_t more = network.bytes - base;
    l4d_query query = time_query(0.7);
    query.whole_buckets = 1;
    const l4d_selection s = d.select(query);
    ASSERT_GT(s.sh_bytes, 0u);
    if (block == 0) {
      EXPECT_GE(more, s.bytes);  // both chunks
    } else {
      EXPECT_EQ(more, s.sh_bytes);
    }
  }
}

// The details of a bucket take the place of what was there without them.
TEST(ReadAhead, MoreDetailHoldsNoBucketTwice) {
  const auto memory_of = [](bool base_first) {
    Network network(split_file(), 0);
    DecoderHandle d = opened(network);
    if (base_first) (void)d.slice(0.7, {{0, 0, L4D_DETAIL_BASE_COLOR, 0}});
    (void)d.slice(0.7);
    l4d_counters c = L4D_INIT(l4d_counters);
    d.check(l4d_decoder_get_counters(d.get(), &c));
    return c.memory_bytes;
  };
  EXPECT_EQ(memory_of(true), memory_of(false));
}

TEST(ReadAhead, ReadsSeveralAtOnceWhereTheReaderCan) {
  Network network(minute_file(), 256);
  DecoderHandle d = opened(network);
  (void)d.slice(20);
  EXPECT_GT(network.batches, 0u);
  EXPECT_LE(network.batches, 4u);
  EXPECT_GT(network.reads, 2 * network.batches);
}

// Whatever the limit: where a plain reader gets the slice, so does this one.
TEST(ReadAhead, FitsIntoTheMemoryOfAPlainReader) {
  const Bytes& file = transform_file();
  const SplatArrays want = plain_slice(file, 1.0);
  const auto slice = [&](uint64_t block, uint64_t limit, SplatArrays* out) {
    Network network(file, block);
    try {
      DecoderHandle d = opened(network, limit);
      (void)d.slice(0.2);
      *out = d.slice(1.0);
      return true;
    } catch (const Error& e) {
      EXPECT_EQ(e.status(), L4D_ERR_LIMIT_EXCEEDED) << e.what();
      return false;
    }
  };
  bool refused = false, done = false;
  for (uint64_t limit = 1024; limit < (uint64_t{1} << 24); limit += limit / 7) {
    SplatArrays plain, ahead;
    const bool plain_done = slice(0, limit, &plain), ahead_done = slice(65536, limit, &ahead);
    EXPECT_GE(ahead_done, plain_done) << limit;
    if (ahead_done) {
      EXPECT_TRUE(same_bits(want, ahead)) << limit;
    }
    (plain_done ? done : refused) = true;
  }
  EXPECT_TRUE(refused && done);
}

// The n-th read fails: the call fails with IO or has what it needs, and the next one is right.
TEST(ReadAhead, RecoversFromReadsThatFail) {
  const Bytes& file = transform_file();
  const SplatArrays want = plain_slice(file, 1.0);
  size_t failed = 0, passed = 0;
  for (size_t fail = 2; fail < 40; ++fail) {
    for (const bool many : {false, true}) {
      Network network(file, 512);
      network.many = many;
      DecoderHandle d = opened(network);
      const size_t after = network.reads + fail - 1;
      network.fault = [&](uint64_t, unsigned char*, size_t) { return network.reads == after; };
      try {
        EXPECT_TRUE(same_bits(want, d.slice(1.0)));
        ++passed;
      } catch (const Error& e) {
        EXPECT_EQ(e.status(), L4D_ERR_IO);
        ++failed;
      }
      EXPECT_TRUE(same_bits(want, d.slice(1.0)));
    }
  }
  EXPECT_GT(passed, 0u);  // what was read ahead in vain is read again
  EXPECT_EQ(failed + passed, 2u * 38);
}

// Bytes that arrive wrong are not kept: the next call reads them again.
TEST(ReadAhead, ReadsAgainWhatArrivedWrong) {
  const Bytes& file = transform_file();
  const SplatArrays want = plain_slice(file, 1.0);
  for (const bool tolerant : {false, true}) {
    Network network(file, 512);
    DecoderHandle d = opened(network, 0, tolerant);
    network.fault = [](uint64_t, unsigned char* to, size_t n) {
      to[n / 2] ^= 1;
      return false;
    };
    network.reads = 0;
    if (tolerant) {
      (void)d.slice(1.0);
      EXPECT_GT(num_losses(d), 0u);
    } else {
      EXPECT_THROW((void)d.slice(1.0), Error);
    }
    EXPECT_GT(network.reads, 0u);
    network.fault = nullptr;
    EXPECT_TRUE(same_bits(want, d.slice(1.0)));
    EXPECT_EQ(num_losses(d), 0u);
  }
}

TEST(ReadAhead, AnotherStreamForgetsTheFirst) {
  Network first(transform_file(), 65536), second(lossless_file(), 65536);
  DecoderHandle d = opened(first);
  (void)d.slice(1.0);
  d.open(second.reader());
  EXPECT_TRUE(same_bits(plain_slice(lossless_file(), 1.0), d.slice(1.0)));
}

}  // namespace
}  // namespace l4d
