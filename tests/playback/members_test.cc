// SPDX-License-Identifier: Apache-2.0
// What a user notices of playlists: borders of members, members that are lost, and a producer who
// pauses, dies, begins anew or keeps the last members only.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "tests/common/codec.h"
#include "tests/playback/decoders.h"
#include "tests/playback/recording.h"

namespace l4d::playback::test {
namespace {

using namespace l4d::test;

// Members of two seconds, from 10 on.
class Player {
 public:
  explicit Player(const RecordingShape& shape, uint64_t seed = 1,
                  const l4d_playback_options& options = {})
      : options_(options),
        recording_({&dynamic_file(), &transform_file()}, shape, seed),
        link_(recording_, good_link(), {}, seed) {
    options_.struct_size = sizeof options_;
    EXPECT_TRUE(resolve(&options_).ok());
    engine_ = std::make_unique<Playback>(options_, decoders_);
    engine_->open(0, "list", L4D_OPEN_PLAYLIST, 0);
  }
  static LinkShape good_link() {
    LinkShape s;
    s.rate = 20e6 / 8;
    s.delay = 0.05;
    return s;
  }
  Playback& engine() { return *engine_; }
  Recording& recording() { return recording_; }
  double now() const { return now_; }
  l4d_playback_state state() const { return engine_->state(); }
  void play() { EXPECT_TRUE(engine_->play(now_).ok()); }
  void pause() { EXPECT_TRUE(engine_->pause(now_).ok()); }
  void seek(double time) { EXPECT_TRUE(engine_->seek(now_, time, 0, 7).ok()); }

  void update() {
    engine_->update(now_);
    l4d_playback_item items[64];
    uint32_t count = 0;
    while ((count = engine_->take(items, 64)) > 0) {
      for (uint32_t i = 0; i < count; ++i) {
        if (items[i].kind == L4D_ITEM_REQUEST) link_.request(now_, items[i]);
        if (items[i].kind == L4D_ITEM_REQUEST) requests.push_back(items[i]);
        if (items[i].kind == L4D_ITEM_CANCEL) link_.cancel(items[i].id);
        if (items[i].kind == L4D_ITEM_EVENT) events.push_back(items[i]);
      }
    }
  }
  void run(double seconds) {
    const double end = now_ + seconds;
    update();
    while (now_ < end) {
      now_ = std::max(now_, std::min({end, link_.next_time(), state().wake_at}));
      while (link_.next_time() <= now_) link_.step(now_, engine_.get());
      update();
    }
  }
  uint64_t count(uint32_t event) const {
    return static_cast<uint64_t>(
        std::count_if(events.begin(), events.end(),
                      [event](const l4d_playback_item& item) { return item.event == event; }));
  }
  uint64_t count_live(uint32_t state) const {
    return static_cast<uint64_t>(
        std::count_if(events.begin(), events.end(), [state](const l4d_playback_item& item) {
          return item.event == L4D_EVENT_LIVE && item.value == state;
        }));
  }
  const l4d_playback_item* find(uint32_t event) const {
    for (const l4d_playback_item& item : events) {
      if (item.event == event) return &item;
    }
    return nullptr;
  }

  std::vector<l4d_playback_item> events, requests;

 private:
  l4d_playback_options options_;
  Recording recording_;
  FakeLink link_;
  OwnDecoders decoders_{true};
  std::unique_ptr<Playback> engine_;
  double now_ = 0;
};

RecordingShape live_shape() {
  RecordingShape r;
  r.members = 60;
  r.first = 4;
  return r;
}

TEST(Members, BordersCostNothing) {
  for (const bool one_file : {false, true}) {
    for (const double rate : {1.0, -1.0, 2.0}) {
      RecordingShape shape;
      shape.one_file = one_file;
      shape.standing = true;
      Player p(shape);
      p.run(0.5);
      EXPECT_EQ(p.state().begin, 10);
      EXPECT_EQ(p.state().end, 26);
      EXPECT_EQ(p.state().live, uint32_t{L4D_LIVE_NONE});
      p.seek(rate > 0 ? 10 : 26);
      p.engine().set_rate(p.now(), rate);
      p.play();
      p.run(20);
      EXPECT_EQ(p.state().motion, uint32_t{L4D_MOTION_ENDED}) << rate;
      EXPECT_EQ(p.state().anchor_time, rate > 0 ? 26 : 10);
      EXPECT_EQ(p.state().waits, 0u) << rate;
      EXPECT_EQ(p.count(L4D_EVENT_OPENED), 9u);
      EXPECT_EQ(p.count(L4D_EVENT_LOST), 0u);
      for (const l4d_playback_item& r : p.requests) {
        EXPECT_EQ((r.flags & L4D_REQUEST_PLAYLIST) != 0, r.source == 0);
      }
    }
  }
}

TEST(Members, ShownLossesAndUris) {
  RecordingShape shape;
  shape.standing = true;
  shape.absent = {1};
  Player p(shape);
  p.run(1);
  std::vector<l4d_shown_member> shown;
  p.engine().shown(-HUGE_VAL, HUGE_VAL, &shown);
  ASSERT_EQ(shown.size(), 12u) << "8, and the standing one 4 times";
  EXPECT_EQ(shown[0].stream, 1u);
  EXPECT_EQ(shown[0].shift, 10);
  EXPECT_EQ(shown[1].stream, 0u);
  EXPECT_EQ(shown[1].standing, 1u);
  p.engine().shown(12.5, 13, &shown);
  ASSERT_EQ(shown.size(), 1u);
  EXPECT_EQ(shown[0].stream, 2u);
  EXPECT_STREQ(p.engine().uri(0), "list");
  EXPECT_STREQ(p.engine().uri(3), "2.l4d");
  EXPECT_EQ(p.engine().uri(100), nullptr);
  std::vector<l4d_playback_loss> losses;
  p.engine().losses(&losses);
  ASSERT_EQ(losses.size(), 1u);
  EXPECT_EQ(losses[0].stream, 2u);
  EXPECT_EQ(losses[0].cause, uint32_t{L4D_CAUSE_NOT_FOUND});
  EXPECT_EQ(losses[0].size, 0u);
}

TEST(Members, WhatIsLostCostsItsSpan) {
  RecordingShape shape;
  shape.absent = {2};
  shape.damaged = {4};
  shape.gap = 0.5;
  Player p(shape);
  p.play();
  p.run(30);
  EXPECT_EQ(p.state().motion, uint32_t{L4D_MOTION_ENDED});
  EXPECT_LE(p.state().waits, 1u);
  const l4d_playback_item* const lost = p.find(L4D_EVENT_LOST);
  ASSERT_NE(lost, nullptr);
  EXPECT_EQ(lost->stream, 3u);
  EXPECT_EQ(lost->cause, uint32_t{L4D_CAUSE_NOT_FOUND});
}

TEST(Members, ALostBeginIsPassedOver) {
  RecordingShape shape;
  shape.absent = {0, 1};
  Player p(shape);
  p.play();
  p.run(3);
  EXPECT_EQ(p.count(L4D_EVENT_JUMPED), 2u);
  EXPECT_EQ(p.state().motion, uint32_t{L4D_MOTION_PLAYING});
  EXPECT_GT(p.state().anchor_time, 14);
  // All of them: a cause, and the time of the next attempt.
  for (uint32_t k = 0; k < 8; ++k) shape.absent.insert(k);
  Player none(shape);
  none.play();
  none.run(3);
  EXPECT_EQ(none.state().stream, uint32_t{L4D_STREAM_FAILED});
  EXPECT_EQ(none.state().cause, uint32_t{L4D_CAUSE_NOT_FOUND});
  EXPECT_TRUE(std::isfinite(none.state().retry_at));
}

TEST(Members, FarOnesAreClosed) {
  RecordingShape shape;
  shape.members = 40;
  shape.first = 40;
  Player p(shape);
  p.engine().set_rate(0, 8);
  p.play();
  p.run(20);
  EXPECT_EQ(p.state().motion, uint32_t{L4D_MOTION_ENDED});
  EXPECT_GT(p.count(L4D_EVENT_CLOSED), 20u);
  EXPECT_LT(p.engine().presentation().parts().size(), 12u);
  p.seek(11);
  p.run(1);
  EXPECT_EQ(p.state().ready, 1u);
}

TEST(Live, BeginsBehindTheEndAndEnds) {
  RecordingShape shape = live_shape();
  shape.members = 12;
  Player p(shape);
  p.play();
  p.run(2);
  EXPECT_EQ(p.state().live, uint32_t{L4D_LIVE_ON_TIME});
  EXPECT_NEAR(p.state().live_delay, 4, 0.8) << "two target durations";
  EXPECT_EQ(p.state().live_distance, 4);
  p.run(30);
  EXPECT_EQ(p.state().live, uint32_t{L4D_LIVE_ENDED});
  EXPECT_EQ(p.state().motion, uint32_t{L4D_MOTION_ENDED});
  EXPECT_EQ(p.state().waits, 0u);
  EXPECT_GE(p.count(L4D_EVENT_GROWN), 8u);
}

// Invariant I8.
TEST(Live, APauseOfTheProducerCostsOneWait) {
  for (uint64_t seed = 1; seed <= 12; ++seed) {
    RecordingShape shape = live_shape();
    shape.pause_from = 8 + 0.17 * static_cast<double>(seed);
    shape.pause_until = shape.pause_from + 6;
    shape.jitter = seed % 3 == 0 ? 0.3 : 0;
    Player p(shape, seed);
    p.run(0.1 * static_cast<double>(seed));
    p.play();
    p.run(30);
    EXPECT_EQ(p.state().waits, 1u) << seed;
    EXPECT_GT(p.state().live_distance, 4) << "it has grown";
    p.run(38);
    EXPECT_EQ(p.state().waits, 1u) << seed;
    EXPECT_NEAR(p.state().live_delay, p.state().live_distance, 1.05) << seed;
    EXPECT_EQ(p.count(L4D_EVENT_JUMPED), 0u) << seed;
  }
}

// What 14 seconds in which nothing could be had have cost, the rate would make good in minutes.
TEST(Live, ALongWaitEndsAtTheLivePosition) {
  RecordingShape shape = live_shape();
  shape.catches_up = true;
  shape.pause_from = 8;
  shape.pause_until = 22;
  Player p(shape);
  p.play();
  p.run(26);
  EXPECT_EQ(p.state().waits, 1u);
  EXPECT_EQ(p.count(L4D_EVENT_JUMPED), 1u);
  EXPECT_EQ(p.state().motion, uint32_t{L4D_MOTION_PLAYING});
  EXPECT_EQ(p.state().live, uint32_t{L4D_LIVE_ON_TIME});
  EXPECT_NEAR(p.state().live_delay, p.state().live_distance, 1.05);
}

TEST(Live, AProducerThatDiesIsAnEventAndComesBack) {
  RecordingShape shape = live_shape();
  shape.pause_from = 8;
  shape.pause_until = 100;
  Player p(shape);
  p.play();
  p.run(60);
  EXPECT_EQ(p.state().live, uint32_t{L4D_LIVE_STALE});
  EXPECT_EQ(p.count_live(L4D_LIVE_STALE), 1u);
  EXPECT_EQ(p.state().motion, uint32_t{L4D_MOTION_WAITING});
  EXPECT_EQ(p.state().waits, 1u);
  const size_t before = p.requests.size();
  p.run(30);
  EXPECT_LE(p.requests.size() - before, 5u) << "it backs off";
  p.run(40);
  EXPECT_NE(p.state().live, uint32_t{L4D_LIVE_STALE});
  EXPECT_EQ(p.state().motion, uint32_t{L4D_MOTION_PLAYING});
  EXPECT_EQ(p.state().waits, 1u);
}

TEST(Live, AProducerThatBeginsAnew) {
  for (const bool states_stream : {true, false}) {
    RecordingShape shape = live_shape();
    shape.restart_at = 20;
    shape.states_stream = states_stream;
    Player p(shape);
    p.play();
    p.run(19);
    EXPECT_GT(p.state().anchor_time, 25);
    p.run(25);
    EXPECT_EQ(p.count_live(L4D_LIVE_RESTARTED), 1u) << states_stream;
    EXPECT_EQ(p.state().live, uint32_t{L4D_LIVE_ON_TIME});
    EXPECT_EQ(p.state().motion, uint32_t{L4D_MOTION_PLAYING});
    EXPECT_NEAR(p.state().live_delay, p.state().live_distance, 1.5);
  }
  RecordingShape shape = live_shape();
  shape.restart_at = 20;
  l4d_playback_options options{};
  options.refuse_restart = 1;
  Player p(shape, 1, options);
  p.play();
  p.run(25);
  EXPECT_EQ(p.state().stream, uint32_t{L4D_STREAM_FAILED});
  EXPECT_EQ(p.state().cause, uint32_t{L4D_CAUSE_CHANGED});
  p.engine().retry(p.now());
  p.run(5);
  EXPECT_EQ(p.state().stream, uint32_t{L4D_STREAM_OPEN});
}

TEST(Live, AListThatLosesItsFront) {
  RecordingShape shape = live_shape();
  shape.window = 4;
  Player p(shape);
  p.play();
  p.run(20);
  EXPECT_EQ(p.state().waits, 0u);
  EXPECT_GT(p.state().begin, 20);
  EXPECT_GT(p.state().anchor_time, p.state().begin);
  // Who pauses finds nothing of what was shown.
  p.pause();
  p.run(15);
  p.play();
  p.run(10);
  EXPECT_EQ(p.count(L4D_EVENT_JUMPED), 1u);
  EXPECT_EQ(p.state().motion, uint32_t{L4D_MOTION_PLAYING});
  EXPECT_GE(p.state().anchor_time, p.state().begin);
}

TEST(Live, ASeekBackStaysThere) {
  Player p(live_shape());
  p.play();
  p.run(40);
  p.seek(12);
  p.run(10);
  EXPECT_EQ(p.state().live, uint32_t{L4D_LIVE_BEHIND});
  EXPECT_EQ(p.state().velocity, 1);
  EXPECT_EQ(p.count(L4D_EVENT_JUMPED), 0u);
  p.seek(HUGE_VAL);
  p.run(2);
  EXPECT_EQ(p.state().live, uint32_t{L4D_LIVE_ON_TIME});
  EXPECT_NEAR(p.state().live_delay, 4, 1);
}

TEST(Live, AnOldCacheIsWaitedOut) {
  RecordingShape shape = live_shape();
  shape.cache_seconds = 40;
  Player p(shape);
  p.play();
  p.run(60);
  EXPECT_EQ(p.count_live(L4D_LIVE_RESTARTED), 0u);
  EXPECT_EQ(p.state().motion, uint32_t{L4D_MOTION_PLAYING});
}

}  // namespace
}  // namespace l4d::playback::test
