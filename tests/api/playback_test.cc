// SPDX-License-Identifier: Apache-2.0
// The playback engine as programs see it: a session over a link that answers at once, a local file,
// a store of the caller's, and careless calls. tests/playback plays sessions of all other kinds.
#include "l4d/playback.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include "l4d/l4d.hpp"
#include "tests/common/codec.h"

namespace l4d {
namespace {

using namespace test;

// Answers what the engine requests, in pieces.
class Server {
 public:
  explicit Server(const Bytes& file) : file_(file) {}
  // What a call of update made: requests are answered, events kept.
  void serve(double now, PlaybackHandle* p) {
    for (const l4d_playback_item& item : p->update(now)) {
      if (item.kind == L4D_ITEM_EVENT) events.push_back(item);
      if (item.kind == L4D_ITEM_LOAD || item.kind == L4D_ITEM_UNLOAD) loads.push_back(item);
      if (item.kind != L4D_ITEM_REQUEST) continue;
      ++requests;
      l4d_answer answer = L4D_INIT(l4d_answer);
      const bool is_whole = (item.flags & L4D_REQUEST_WHOLE) != 0;
      answer.status = is_whole ? 200 : 206;
      answer.offset = item.offset;
      answer.total_bytes = file_.size();
      p->check(l4d_playback_answered(p->get(), now, item.id, &answer));
      const uint64_t end =
          is_whole ? file_.size() : std::min<uint64_t>(item.offset + item.size, file_.size());
      for (uint64_t at = item.offset; at < end; at += 1000) {
        const size_t n = static_cast<size_t>(std::min<uint64_t>(1000, end - at));
        unsigned char bytes[1000];
        std::copy_n(file_.begin() + static_cast<ptrdiff_t>(at), n, bytes);
        for (const uint64_t wrong : damage) {
          if (wrong >= at && wrong < at + n) bytes[wrong - at] ^= 1;
        }
        p->check(l4d_playback_received(p->get(), now, item.id, bytes, n));
      }
      p->check(l4d_playback_finished(p->get(), now, item.id, L4D_TRANSFER_ENDED));
    }
  }
  uint64_t count(uint32_t event) const {
    uint64_t n = 0;
    for (const l4d_playback_item& item : events) n += item.event == event ? 1 : 0;
    return n;
  }

  std::vector<l4d_playback_item> events, loads;
  std::vector<uint64_t> damage;
  uint64_t requests = 0;

 private:
  const Bytes& file_;
};

double time_of(const l4d_playback_state& s, double now) {
  const double time = s.anchor_time + (now - s.anchor_now) * s.velocity;
  return std::min(std::max(time, s.ready_from), s.ready_until);
}

// A recording that has just begun: the file is there, and empty. Nothing waits for ever, and the
// stream plays once there is one.
TEST(PlaybackLink, AnEmptyFileFailsAndIsLookedForAgain) {
  for (const uint32_t status : {416u, 200u, 206u}) {
    PlaybackHandle p;
    Server server(dynamic_file());
    p.open(0, "file");
    p.play(0);
    p.check(l4d_playback_seek(p.get(), 0, 1, 0, 7));
    double now = 0;
    bool failed = false;
    for (; now < 60 && !failed; now += 0.25) {
      for (const l4d_playback_item& item : p.update(now)) {
        if (item.kind == L4D_ITEM_EVENT) server.events.push_back(item);
        if (item.kind != L4D_ITEM_REQUEST) continue;
        l4d_answer answer = L4D_INIT(l4d_answer);
        answer.status = status;
        answer.offset = status == 206 ? item.offset : 0;
        p.check(l4d_playback_answered(p.get(), now, item.id, &answer));
        p.check(l4d_playback_finished(p.get(), now, item.id, L4D_TRANSFER_ENDED));
      }
      failed = p.state().stream == L4D_STREAM_FAILED;
    }
    ASSERT_TRUE(failed) << status;
    EXPECT_EQ(p.state().cause, uint32_t{L4D_CAUSE_TRUNCATED}) << status;
    EXPECT_TRUE(std::isfinite(p.state().retry_at)) << status;
    for (const l4d_playback_item& item : p.update(now)) {
      if (item.kind == L4D_ITEM_EVENT) server.events.push_back(item);
    }
    EXPECT_EQ(server.count(L4D_EVENT_FAILED), 1u) << status;  // of the seek
    // The file has come.
    now = std::max(now, p.state().retry_at) + 0.1;
    for (const double end = now + 30; now < end && p.state().ready == 0; now += 0.1) {
      server.serve(now, &p);
    }
    EXPECT_EQ(p.state().ready, 1u) << status;
  }
}

class PlaybackFiles : public testing::TestWithParam<NamedFile> {};

TEST_P(PlaybackFiles, ShowsWhatTheFileShows) {
  const Bytes& file = GetParam().bytes();
  DecoderHandle whole;
  whole.open_memory(file.data(), file.size());
  const l4d_reader reader = memory_reader(file);
  for (const bool is_local : {false, true}) {
    PlaybackHandle p;
    Server server(file);
    is_local ? p.open(0, reader) : p.open(0, "file");
    p.play(0);
    int pictures = 0;
    double now = 0, last = -1;
    for (; now < 10 && p.state().motion != L4D_MOTION_ENDED; now += 1.0 / 30) {
      for (int i = 0; i < 10; ++i) server.serve(now, &p);
      const l4d_playback_state s = p.state();
      ASSERT_NE(s.stream, uint32_t{L4D_STREAM_FAILED});
      if (s.ready == 0) continue;
      const double time = time_of(s, now);
      EXPECT_GE(time, last);
      last = time;
      if (++pictures % 10 != 1) continue;
      const bool full = s.rung + 1 == s.num_rungs;
      const SplatArrays got = p.slice(time);
      if (full) {
        EXPECT_TRUE(same_bits(got, whole.slice(time))) << time;
      }
      EXPECT_GT(got.count(), 0u);
    }
    EXPECT_EQ(p.state().motion, uint32_t{L4D_MOTION_ENDED});
    EXPECT_EQ(p.state().waits, 0u);
    EXPECT_NEAR(now, p.state().end - p.state().begin, 0.2) << "plays as fast as it should";
    EXPECT_GT(pictures, 50);
    EXPECT_EQ(server.requests == 0, is_local);
    EXPECT_LT(server.requests, 60u);
    // From the end it plays again, and backwards.
    p.check(l4d_playback_set_rate(p.get(), now, -1));
    p.play(now);
    server.serve(now, &p);
    server.serve(now + 0.5, &p);
    EXPECT_LT(p.state().anchor_time, p.state().end - 0.2);
    EXPECT_EQ(server.count(L4D_EVENT_LOST), 0u);
  }
}

INSTANTIATE_TEST_SUITE_P(Files, PlaybackFiles,
                         testing::Values(NamedFile{"dynamic", dynamic_file},
                                         NamedFile{"rcq", rcq_file},
                                         NamedFile{"transform", transform_file},
                                         NamedFile{"lossless", lossless_file}),
                         file_name);

// A caller that keeps the buckets gets each once, and never more than its store holds.
TEST(Playback, LoadsForTheCaller) {
  const Bytes& file = dynamic_file();
  for (const uint64_t max_units : {uint64_t{0}, uint64_t{1800}}) {
    l4d_playback_options options = L4D_INIT(l4d_playback_options);
    options.loader = L4D_LOADER_CALLER;
    options.max_units = max_units;
    options.max_loads = 3;
    PlaybackHandle p(&options);
    Server server(file);
    p.open(0, "file", file.size());
    p.play(0);
    std::map<std::pair<uint32_t, uint32_t>, uint64_t> held;
    uint64_t units = 0, loads = 0, most = 0;
    for (double now = 0; now < 4; now += 0.01) {
      server.serve(now, &p);
      EXPECT_LE(server.loads.size(), 64u);
      for (const l4d_playback_item& item : std::exchange(server.loads, {})) {
        const std::pair<uint32_t, uint32_t> key(item.layer, item.bucket);
        if (item.kind == L4D_ITEM_UNLOAD) {
          EXPECT_EQ(held.count(key), 1u);
          units -= held[key];
          held.erase(key);
          continue;
        }
        ++loads;
        EXPECT_EQ(held.count(key), 0u) << "loaded twice";
        l4d_decoder* decoder = nullptr;
        p.check(l4d_playback_get_decoder(p.get(), 0, &decoder));
        const l4d_bucket bucket = {item.layer, item.bucket};
        l4d_query query = L4D_INIT(l4d_query);
        query.kind = L4D_QUERY_BUCKETS;
        query.buckets = &bucket;
        query.num_buckets = 1;
        l4d_selection selection = L4D_INIT(l4d_selection);
        p.check(l4d_decoder_select(decoder, &query, &selection));
        EXPECT_EQ(selection.num_gaussians, item.units);
        std::vector<float> position(3 * static_cast<size_t>(item.units));
        l4d_gaussian_buffers out = L4D_INIT(l4d_gaussian_buffers);
        out.capacity = item.units;
        out.position = position.data();
        p.check(l4d_decoder_decode(decoder, &query, &out));
        held[key] = item.units;
        units += item.units;
        most = std::max(most, units);
        p.check(l4d_playback_loaded(p.get(), now, item.id, out.count, L4D_OK));
      }
      EXPECT_EQ(p.state().units, units);
    }
    if (max_units > 0) {
      EXPECT_LE(most, max_units);
    }
    EXPECT_GT(loads, 3u);
    EXPECT_TRUE(p.state().motion == L4D_MOTION_ENDED || max_units > 0);
    l4d_splat_buffers splats = L4D_INIT(l4d_splat_buffers);
    EXPECT_EQ(l4d_playback_slice(p.get(), 0, &splats), L4D_ERR_INVALID_STATE);
  }
}

// Headers that are wrong a few times, each time otherwise or the same, and then right.
TEST(Playback, WrongHeadersAreNotForEver) {
  const Bytes& file = dynamic_file();
  for (const uint64_t at : {3u, 20u, 41u, 60u, 200u, 1000u}) {
    PlaybackHandle p;
    Server server(file);
    server.damage = {at};
    p.open(0, "file", file.size());
    p.seek(0, 0.5, 0, 7);
    double now = 0;
    for (; now < 2; now += 0.1) server.serve(now, &p);
    l4d_playback_state s = p.state();
    if (s.stream == L4D_STREAM_FAILED) {
      EXPECT_NE(s.cause, uint32_t{L4D_CAUSE_NONE});
      EXPECT_LT(s.retry_at, 100) << "it is tried again by itself";
      EXPECT_EQ(server.count(L4D_EVENT_FAILED), 1u);
      const uint64_t before = server.requests;
      for (; now < s.retry_at - 1; now += 1) server.serve(now, &p);
      EXPECT_EQ(server.requests, before);
    } else {
      EXPECT_NE(s.stream, uint32_t{L4D_STREAM_CLOSED});
    }
    server.damage.clear();
    for (; now < 80; now += 0.5) server.serve(now, &p);
    s = p.state();
    EXPECT_EQ(s.stream, uint32_t{L4D_STREAM_OPEN}) << at;
    EXPECT_EQ(s.ready, 1u) << at;
  }
}

TEST(Playback, CarelessCalls) {
  l4d_playback* p = nullptr;
  l4d_playback_options options = L4D_INIT(l4d_playback_options);
  options.ahead = -1;
  EXPECT_EQ(l4d_playback_create(&options, &p), L4D_ERR_INVALID_ARGUMENT);
  options.ahead = 0.1;
  EXPECT_EQ(l4d_playback_create(&options, &p), L4D_ERR_INVALID_ARGUMENT) << "start_ahead is more";
  options.ahead = 0;
  options.loader = 2;
  EXPECT_EQ(l4d_playback_create(&options, &p), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_playback_create(nullptr, nullptr), L4D_ERR_INVALID_ARGUMENT);
  l4d_playback_destroy(nullptr);
  ASSERT_EQ(l4d_playback_create(nullptr, &p), L4D_OK);
  EXPECT_EQ(l4d_playback_play(p, 0), L4D_ERR_INVALID_STATE);
  EXPECT_EQ(l4d_playback_seek(p, 0, 1, 0, 1), L4D_ERR_INVALID_STATE);
  EXPECT_EQ(l4d_playback_update(p, 0), L4D_OK);
  EXPECT_EQ(l4d_playback_close(p, 0), L4D_OK);
  EXPECT_EQ(l4d_playback_open(p, 0, nullptr, L4D_OPEN_STREAM, 0), L4D_ERR_INVALID_ARGUMENT);
  const l4d_reader none = L4D_INIT(l4d_reader);
  EXPECT_EQ(l4d_playback_open_reader(p, 0, &none), L4D_ERR_INVALID_ARGUMENT);
  ASSERT_EQ(l4d_playback_open(p, 0, "uri", L4D_OPEN_STREAM, 0), L4D_OK);
  const char* uri = nullptr;
  EXPECT_EQ(l4d_playback_get_uri(p, 0, &uri), L4D_OK);
  EXPECT_STREQ(uri, "uri");
  EXPECT_EQ(l4d_playback_get_uri(p, 1, &uri), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_playback_update(p, NAN), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_playback_seek(p, 0, NAN, 0, 1), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_playback_seek(p, 0, 1, -1, 1), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_playback_set_rate(p, 0, 65), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_playback_set_range(p, 0, 3, 0, 1), L4D_ERR_INVALID_ARGUMENT);
  l4d_quality quality = L4D_INIT(l4d_quality);
  quality.network = 4;
  EXPECT_EQ(l4d_playback_set_quality(p, 0, &quality), L4D_ERR_INVALID_ARGUMENT);
  quality = L4D_INIT(l4d_quality);
  quality.struct_size = 4;
  EXPECT_EQ(l4d_playback_set_quality(p, 0, &quality), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_playback_finished(p, 0, 9, 3), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_playback_finished(p, 0, 9, 0), L4D_OK) << "of a request that never was";
  EXPECT_EQ(l4d_playback_received(p, 0, 9, nullptr, 5), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_playback_loaded(p, 0, 9, 5, L4D_OK), L4D_OK);
  l4d_decoder* decoder = nullptr;
  EXPECT_EQ(l4d_playback_get_decoder(p, 0, &decoder), L4D_ERR_NEED_DATA);
  EXPECT_EQ(l4d_playback_get_decoder(p, 1, &decoder), L4D_ERR_NEED_DATA);
  l4d_splat_buffers splats = L4D_INIT(l4d_splat_buffers);
  EXPECT_EQ(l4d_playback_slice(p, 0, &splats), L4D_ERR_NEED_DATA);
  uint64_t count = 1;
  EXPECT_EQ(l4d_playback_get_buffered(p, nullptr, 0, &count), L4D_OK);
  EXPECT_EQ(count, 0u);
  EXPECT_EQ(l4d_playback_play(nullptr, 0), L4D_ERR_INVALID_ARGUMENT);
  l4d_playback_destroy(p);
}

}  // namespace
}  // namespace l4d
