// SPDX-License-Identifier: Apache-2.0
// What a feed of buckets promises to a player, with a store that has no device.
#include "render/cuda/player/bucket_feed.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "l4d/l4d.hpp"
#include "tests/common/codec.h"
#include "tests/common/random.h"

namespace l4d::render {
namespace {

constexpr uint32_t kChunk = 64;

// Ten seconds with much that lives for a short time, with SH detail.
const Bytes& long_file() {
  static const Bytes kBytes = [] {
    test::SceneOptions scene;
    scene.count = 12000;
    scene.num_frames = 300;
    scene.permanent = 0.05;
    scene.sh_degree = 3;
    test::EncodeOptions o;
    o.preset = "default";
    o.rans = true;
    o.settings = {{L4D_ENC_MERGE_COUNT, 40}, {L4D_ENC_PAGE_SIZE, 256}};
    return test::encode(test::make_scene(scene), o).bytes;
  }();
  return kBytes;
}

l4d_reader reader_of(const Bytes& bytes) {
  l4d_reader r = L4D_INIT(l4d_reader);
  r.user = const_cast<Bytes*>(&bytes);
  r.read_at = [](void* user, void* dst, size_t n, uint64_t offset) -> int64_t {
    const Bytes& b = *static_cast<const Bytes*>(user);
    if (offset >= b.size()) return 0;
    n = std::min(n, b.size() - static_cast<size_t>(offset));
    std::copy_n(b.data() + offset, n, static_cast<unsigned char*>(dst));
    return static_cast<int64_t>(n);
  };
  r.size = [](void* user) -> int64_t {
    return static_cast<int64_t>(static_cast<const Bytes*>(user)->size());
  };
  return r;
}

// Remembers which bucket each chunk has, and fails where a test says so.
class FakeStore : public BucketStore {
 public:
  Status open(l4d_decoder*) override { return opened; }
  Status prepare(l4d_decoder* decoder, const l4d_query& query, uint64_t gaussians) override {
    for (uint64_t k = 0; k < query.num_buckets; ++k) {
      if (corrupt.count({query.buckets[k].layer, query.buckets[k].bucket}) != 0) {
        return Status(L4D_ERR_CORRUPT, "as the test says");
      }
    }
    // All bytes are here.
    std::vector<float> position(static_cast<size_t>(3 * gaussians));
    std::vector<float> sh(static_cast<size_t>(48 * gaussians));
    l4d_gaussian_buffers out = L4D_INIT(l4d_gaussian_buffers);
    out.capacity = gaussians;
    out.position = position.data();
    out.sh = sh.data();
    const l4d_status status = l4d_decoder_decode(decoder, &query, &out);
    if (status != L4D_OK) return Status(status, l4d_last_error_message());
    EXPECT_EQ(out.count, gaussians);
    ++batches;
    return {};
  }
  Status decode() override {
    return fails.exchange(false) ? Status(L4D_ERR_DEVICE, "as the test says") : Status();
  }
  Status reserve(uint32_t chunks) override {
    EXPECT_GE(chunks, owners.size());
    owners.resize(chunks);
    return {};
  }
  Status place(const std::vector<BucketPlace>& batch, bool shown) override {
    BucketKey last{};
    for (const BucketPlace& b : batch) {
      EXPECT_TRUE(&b == &batch[0] || last < b.key);
      last = b.key;
      EXPECT_EQ(b.chunks.size(), (b.slots + kChunk - 1) / kChunk);
      for (const uint32_t chunk : b.chunks) {
        ASSERT_OK(chunk < owners.size());
        owners[chunk] = {b.key.layer, b.key.bucket};
      }
    }
    replaced += shown;
    return {};
  }
  Status finish() override { return {}; }

  Status opened;
  std::atomic<bool> fails{false};
  std::atomic<uint64_t> batches{0}, replaced{0};
  std::set<std::pair<uint32_t, uint32_t>> corrupt;
  std::vector<std::pair<uint32_t, uint32_t>> owners;  // by chunk

 private:
  static void ASSERT_OK(bool ok) {
    if (!ok) throw std::logic_error("a chunk is outside the store");
  }
};

class Feeding {
 public:
  explicit Feeding(const Bytes& bytes) : bytes_(bytes), reader_(reader_of(bytes_)) {
    options.reader = &reader_;
    static_cast<void>(l4d_decoder_open_memory(whole_.get(), bytes_.data(), bytes_.size()));
  }
  ~Feeding() {
    stop_ = true;
    if (link_.joinable()) link_.join();
    feed.stop();
  }
  Status open() { return feed.open(options); }
  void over_a_link() {
    options.reader = nullptr;
    options.uri = "a.l4d";
  }
  // Requests get their bytes, some at a time.
  void feed_some() {
    l4d_playback_item items[16];
    const uint32_t n = feed.take(items, 16);
    for (uint32_t i = 0; i < n; ++i) {
      if (items[i].kind != L4D_ITEM_REQUEST) continue;
      ++requests;
      const uint64_t end = items[i].size == 0 ? bytes_.size() : items[i].offset + items[i].size;
      l4d_answer answer = L4D_INIT(l4d_answer);
      answer.status = 206;
      answer.offset = items[i].offset;
      answer.total_bytes = bytes_.size();
      EXPECT_EQ(feed.answered(items[i].id, &answer), L4D_OK);
      for (uint64_t at = items[i].offset; at < end; at += 5000) {
        const size_t some = static_cast<size_t>(std::min<uint64_t>(5000, end - at));
        EXPECT_EQ(feed.received(items[i].id, bytes_.data() + at, some), L4D_OK);
      }
      EXPECT_EQ(feed.finished(items[i].id, L4D_TRANSFER_ENDED), L4D_OK);
    }
    if (n == 0) std::this_thread::sleep_for(std::chrono::microseconds(100));
  }
  void start_link() {
    link_ = std::thread([this] {
      while (!stop_) feed_some();
    });
  }

  l4d_status await(double time) {
    auto lock = feed.lock();
    const Status status = feed.await(time, &lock);
    if (status.ok()) check(feed.clamped(time));
    return status.code();
  }
  l4d_cuda_player_counters counters() {
    const auto lock = feed.lock();
    l4d_cuda_player_counters c{};
    feed.count(&c);
    return c;
  }
  // Buckets that an instant shows.
  std::vector<l4d_bucket_span> shown_at(double time) {
    l4d_query query = test::time_query(time);
    query.whole_buckets = 1;
    std::vector<l4d_bucket_span> spans(1000);
    uint64_t count = 0;
    EXPECT_EQ(l4d_decoder_get_spans(whole_.get(), &query, spans.data(), spans.size(), &count),
              L4D_OK);
    spans.resize(static_cast<size_t>(count));
    return spans;
  }
  uint64_t all() const { return whole_.info().num_gaussians; }

  l4d_playback_options playback = L4D_INIT(l4d_playback_options);
  l4d_cuda_player_options options = L4D_INIT(l4d_cuda_player_options);
  FakeStore store;
  BucketFeed feed{&store, kChunk};
  std::atomic<uint64_t> requests{0};

 private:
  // Under the lock: all that the instant shows is in its chunks.
  void check(double time) {
    const ResidentBuckets::Buckets& all = feed.residents().all();
    for (const l4d_bucket_span& span : shown_at(time)) {
      const auto found = all.find({0, span.layer, span.bucket});
      ASSERT_NE(found, all.end()) << time << ": " << span.layer << "/" << span.bucket;
      const ResidentBucket& bucket = found->second;
      ASSERT_TRUE(bucket.filled);
      ASSERT_EQ(bucket.slots, span.count);
      ASSERT_LE(bucket.begin, time);
      ASSERT_GE(bucket.end, time);
      for (const uint32_t chunk : bucket.chunks) {
        ASSERT_EQ(store.owners[chunk], std::make_pair(span.layer, span.bucket)) << time;
      }
    }
  }

  const Bytes bytes_;
  l4d_reader reader_;
  DecoderHandle whole_;
  std::thread link_;
  std::atomic<bool> stop_{false};
};

TEST(BucketFeed, HasWhatEachInstantShows) {
  Feeding f(long_file());
  ASSERT_TRUE(f.open().ok());
  uint64_t most = 0;
  for (int k = -3; k <= 303; ++k) {
    ASSERT_EQ(f.await(k / 30.0), L4D_OK) << k;
    most = std::max(most, f.counters().resident_gaussians);
  }
  EXPECT_LT(most, f.all() * 2 / 3) << "what is over stays";
  EXPECT_LT(f.counters().gaussians_decoded, f.all() * 5 / 4) << "buckets are decoded again";
  test::Random random(3);
  for (int k = 0; k < 200; ++k) ASSERT_EQ(f.await(random.uniform(-1, 11)), L4D_OK);
  EXPECT_EQ(f.await(HUGE_VAL), L4D_OK);
  EXPECT_EQ(f.await(-HUGE_VAL), L4D_OK);
}

TEST(BucketFeed, ReadsAheadInTheDirectionOfTheRate) {
  for (const double rate : {1.0, -1.0}) {
    Feeding f(long_file());
    ASSERT_TRUE(f.open().ok());
    ASSERT_EQ(f.feed.set_rate(rate), L4D_OK);
    ASSERT_EQ(f.await(5), L4D_OK);
    const double there = 5 + 0.4 * rate;
    const auto is_ready = [&] {
      const l4d_playback_state s = f.feed.state();
      return s.ready_from <= there && there <= s.ready_until;
    };
    while (!is_ready()) std::this_thread::yield();
    const uint64_t stalls = f.counters().stalls;
    EXPECT_EQ(f.await(there), L4D_OK);
    EXPECT_EQ(f.counters().stalls, stalls);
  }
}

TEST(BucketFeed, KeepsWhatFitsIntoMaxUnits) {
  Feeding f(long_file());
  f.playback.max_units = 1 << 20;
  f.options.playback = &f.playback;
  ASSERT_TRUE(f.open().ok());
  for (int round = 0; round < 2; ++round) {
    for (int k = 0; k <= 100; ++k) ASSERT_EQ(f.await(k / 10.0), L4D_OK);
    // All but what no instant shows, and nothing twice.
    EXPECT_GT(f.counters().resident_gaussians, f.all() * 9 / 10);
    EXPECT_LE(f.counters().gaussians_decoded, f.all());
  }
  EXPECT_EQ(f.store.owners.size(), (1u << 20) / kChunk);
}

TEST(BucketFeed, UnloadsForWhatMaxUnitsDoesNotHold) {
  Feeding f(long_file());
  f.playback.max_units = f.all() * 4 / 5;
  f.options.playback = &f.playback;
  ASSERT_TRUE(f.open().ok());
  test::Random random(4);
  for (int k = 0; k < 300; ++k) {
    const double time = k % 3 == 0 ? random.uniform(0, 10) : k / 30.0;
    ASSERT_EQ(f.await(time), L4D_OK) << time;
  }
  EXPECT_LE(f.store.owners.size(), f.all() * 4 / 5 / kChunk);
}

TEST(BucketFeed, SaysWhereMaxUnitsIsTooSmall) {
  Feeding f(long_file());
  f.playback.max_units = 2 * kChunk;
  f.options.playback = &f.playback;
  ASSERT_TRUE(f.open().ok());
  EXPECT_EQ(f.await(1), L4D_ERR_LIMIT_EXCEEDED);
  EXPECT_EQ(f.await(7), L4D_ERR_LIMIT_EXCEEDED);
  Feeding none(long_file());
  none.playback.max_units = kChunk - 1;
  none.options.playback = &none.playback;
  EXPECT_EQ(none.open().code(), L4D_ERR_LIMIT_EXCEEDED);
}

TEST(BucketFeed, TellsDamageWhereItIsShown) {
  // In a page that some times need, and the first second does not.
  Bytes damaged;
  for (size_t at = long_file().size() - 100; damaged.empty(); at -= 700) {
    ASSERT_GT(at, long_file().size() / 10);
    Bytes bytes = long_file();
    bytes[at] ^= 0x40;
    DecoderHandle host;
    host.open_memory(bytes.data(), bytes.size());
    l4d_splat_buffers splats = L4D_INIT(l4d_splat_buffers);
    const auto shows = [&](double time) {
      return l4d_decoder_slice(host.get(), time, &splats) != L4D_ERR_CHECKSUM;
    };
    if (!shows(0) || !shows(0.5) || !shows(1)) continue;
    for (int k = 5; k <= 50 && damaged.empty(); ++k) {
      if (!shows(k / 5.0)) damaged = bytes;
    }
  }
  for (const bool link : {false, true}) {
    Feeding f(damaged);
    if (link) f.over_a_link();
    ASSERT_TRUE(f.open().ok());
    if (link) f.start_link();
    int failed = 0;
    for (int k = 0; k <= 50; ++k) {
      const l4d_status status = f.await(k / 5.0);
      EXPECT_TRUE(status == L4D_OK || status == L4D_ERR_CHECKSUM) << status;
      failed += status != L4D_OK;
    }
    EXPECT_GT(failed, 0);
    EXPECT_LT(failed, 51);
  }
}

TEST(BucketFeed, BlamesTheBucketThatIsCorrupt) {
  Feeding f(long_file());
  std::vector<l4d_bucket_span> at = f.shown_at(8.5);
  // Of a fine layer: few instants show it.
  const l4d_bucket_span bad = at.back();
  f.store.corrupt = {{bad.layer, bad.bucket}};
  ASSERT_TRUE(f.open().ok());
  for (int k = 0; k <= 100; ++k) {
    const double time = k / 10.0;
    bool shows = false;
    for (const l4d_bucket_span& span : f.shown_at(time)) {
      shows = shows || (span.layer == bad.layer && span.bucket == bad.bucket);
    }
    EXPECT_EQ(f.await(time), shows ? L4D_ERR_CORRUPT : L4D_OK) << time;
  }
}

TEST(BucketFeed, TriesAgainAfterAFailureOfTheDevice) {
  Feeding f(long_file());
  f.options.no_read_ahead = 1;
  ASSERT_TRUE(f.open().ok());
  ASSERT_EQ(f.await(1), L4D_OK);
  for (const double time : {4.0, 8.0}) {
    f.store.fails = true;
    EXPECT_EQ(f.await(time), L4D_ERR_DEVICE);
    EXPECT_EQ(f.await(time), L4D_OK);
  }
}

TEST(BucketFeed, OpensOnlyWhatItCanPlay) {
  Feeding f(long_file());
  f.store.opened = Status(L4D_ERR_FEATURE_UNSUPPORTED, "as the test says");
  EXPECT_EQ(f.open().code(), L4D_ERR_FEATURE_UNSUPPORTED);
  EXPECT_EQ(f.await(1), L4D_ERR_FEATURE_UNSUPPORTED);
  Feeding other(Bytes(100, 7));
  EXPECT_EQ(other.open().code(), L4D_ERR_NOT_L4D);
}

TEST(BucketFeed, PlaysOverALink) {
  Feeding f(long_file());
  f.over_a_link();
  ASSERT_TRUE(f.open().ok());
  f.start_link();
  for (int k = 0; k <= 100; ++k) ASSERT_EQ(f.await(k / 10.0), L4D_OK) << k;
  test::Random random(5);
  for (int k = 0; k < 50; ++k) ASSERT_EQ(f.await(random.uniform(0, 10)), L4D_OK);
  EXPECT_GT(f.requests, 0u);
  EXPECT_EQ(f.store.replaced, 0u) << "in full detail at once";
}

// Who draws may be who has the link.
TEST(BucketFeed, DoesNotWaitIfToldSo) {
  Feeding f(long_file());
  f.over_a_link();
  f.options.no_wait = 1;
  f.options.automatic = 1;
  ASSERT_TRUE(f.open().ok());
  for (int k = 0; k <= 50; ++k) {
    int lacking = 0;
    l4d_status status = L4D_OK;
    while ((status = f.await(k / 5.0)) == L4D_ERR_NEED_DATA) {
      ++lacking;
      f.feed_some();
    }
    ASSERT_EQ(status, L4D_OK) << k;
    EXPECT_TRUE(k > 0 || lacking > 0);
    // Detail comes to what is shown already.
    const auto is_whole = [&] {
      const l4d_playback_state s = f.feed.state();
      return s.rung + 1 == s.num_rungs && s.ready != 0;
    };
    while (k % 10 == 0 && !is_whole()) f.feed_some();
  }
  EXPECT_GT(f.store.replaced, 0u);
}

TEST(BucketFeed, TellsWhereALinkFails) {
  Feeding f(long_file());
  f.over_a_link();
  ASSERT_TRUE(f.open().ok());
  std::thread server([&] {
    l4d_playback_item item{};
    while (f.feed.take(&item, 1) == 0 || item.kind != L4D_ITEM_REQUEST) std::this_thread::yield();
    EXPECT_EQ(f.feed.finished(item.id, L4D_TRANSFER_FORBIDDEN), L4D_OK);
  });
  EXPECT_EQ(f.await(1), L4D_ERR_IO);
  server.join();
}

TEST(BucketFeed, TriesAgainWithoutWaiting) {
  Feeding f(long_file());
  f.options.no_wait = 1;
  ASSERT_TRUE(f.open().ok());
  f.store.fails = true;
  l4d_status status = L4D_ERR_NEED_DATA;
  bool failed = false;
  while ((status = f.await(5)) != L4D_OK) {
    ASSERT_TRUE(status == L4D_ERR_NEED_DATA || (status == L4D_ERR_DEVICE && !failed));
    failed = failed || status == L4D_ERR_DEVICE;
    std::this_thread::yield();
  }
}

// A player goes while its thread works and requests are out.
TEST(BucketFeed, EndsAtAnyTime) {
  for (int k = 0; k < 30; ++k) {
    Feeding f(long_file());
    if (k % 3 == 0) f.over_a_link();
    if (k % 3 == 1) f.options.no_wait = 1;
    ASSERT_TRUE(f.open().ok());
    if (k % 3 != 0) f.await(0.3 * k);
    if (k % 3 == 0 && k % 2 == 0) f.feed_some();
  }
}

}  // namespace
}  // namespace l4d::render
