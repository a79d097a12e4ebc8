// SPDX-License-Identifier: Apache-2.0
// What a user notices of the engine on links that behave: what is shown while a finger drags, how
// playback goes backwards and around, what a link that is silent for a while costs.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <vector>

#include "tests/common/codec.h"
#include "tests/playback/decoders.h"
#include "tests/playback/fake_link.h"

namespace l4d::playback::test {
namespace {

using namespace l4d::test;

// Ten seconds with much that lives for a short time, so that every instant needs bytes of its own.
const Bytes& long_file() {
  static const Bytes kBytes = [] {
    SceneOptions scene;
    scene.count = 48000;
    scene.num_frames = 300;
    scene.permanent = 0.05;
    EncodeOptions o;
    o.preset = "default";
    o.rans = true;
    o.settings = {{L4D_ENC_MERGE_COUNT, 40}};
    return encode(make_scene(scene), o).bytes;
  }();
  return kBytes;
}

class Player {
 public:
  Player(const LinkShape& shape, const Faults& faults, const l4d_playback_options& options = {})
      : options_(options),
        content_(long_file(), long_file(), 1e300),
        link_(content_, shape, faults, 1) {
    options_.struct_size = sizeof options_;
    EXPECT_TRUE(resolve(&options_).ok());
    engine_ = std::make_unique<Playback>(options_, decoders_);
    engine_->open(0, "", L4D_OPEN_STREAM, long_file().size());
  }
  Playback& engine() { return *engine_; }
  double now() const { return now_; }
  l4d_playback_state state() const { return engine_->state(); }

  void update() {
    engine_->update(now_);
    l4d_playback_item items[64];
    uint32_t count = 0;
    while ((count = engine_->take(items, 64)) > 0) {
      for (uint32_t i = 0; i < count; ++i) {
        if (items[i].kind == L4D_ITEM_REQUEST) link_.request(now_, items[i]);
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
  // Time passes, and nobody does anything.
  void sleep(double seconds) {
    now_ += seconds;
    link_.forget();
    update();
  }
  uint64_t count(uint32_t event) const {
    return static_cast<uint64_t>(
        std::count_if(events.begin(), events.end(), [event](const l4d_playback_item& item) {
          return item.kind == L4D_ITEM_EVENT && item.event == event;
        }));
  }
  void play_from(double time, double rate) {
    EXPECT_TRUE(engine_->seek(now_, time, 0, 1).ok());
    engine_->set_rate(now_, rate);
    EXPECT_TRUE(engine_->play(now_).ok());
  }

  std::vector<l4d_playback_item> events;

 private:
  l4d_playback_options options_;
  OneFile content_;
  FakeLink link_;
  OwnDecoders decoders_{true};
  std::unique_ptr<Playback> engine_;
  double now_ = 0;
};

LinkShape good_link() {
  LinkShape s;
  s.rate = 20e6 / 8;
  s.delay = 0.05;
  s.piece = 4096;
  return s;
}

TEST(Behaviour, ADragShowsPicturesAllTheTime) {
  Player p(good_link(), {});
  p.run(2);
  p.events.clear();
  uint32_t id = 100;
  double last_shown = p.now(), longest = 0;
  for (int i = 0; i < 180; ++i) {  // three seconds, from one end to the other and back
    const double time = 5 + 4.9 * std::sin(i * 0.035);
    ASSERT_TRUE(p.engine().seek(p.now(), time, 0.01, ++id).ok());
    const uint64_t before = p.count(L4D_EVENT_SHOWN);
    p.run(1.0 / 60);
    if (p.count(L4D_EVENT_SHOWN) > before) {
      longest = std::max(longest, p.now() - last_shown);
      last_shown = p.now();
    }
  }
  EXPECT_GE(p.count(L4D_EVENT_SHOWN), 12u) << "four a second";
  EXPECT_LT(longest, 0.5);
  ASSERT_TRUE(p.engine().seek(p.now(), 7.77, 0, ++id).ok());
  p.run(1);
  EXPECT_EQ(p.events.back().event, uint32_t{L4D_EVENT_SHOWN});
  EXPECT_EQ(p.events.back().id, id);
  EXPECT_EQ(p.state().anchor_time, 7.77);
  EXPECT_EQ(p.count(L4D_EVENT_SHOWN) + p.count(L4D_EVENT_REPLACED), 181u);
}

// When nothing is under way any more, what has come may be enough for a higher rung.
TEST(Behaviour, APausedPictureGetsAllOfItsDetail) {
  for (const double time : {0.0, 5.0, 9.9}) {
    Player p(good_link(), {});
    ASSERT_TRUE(p.engine().seek(0, time, 0, 1).ok());
    p.run(8);
    ASSERT_GT(p.state().num_rungs, 1u);
    EXPECT_EQ(p.state().rung, p.state().num_rungs - 1) << time;
    EXPECT_EQ(p.state().wake_at, HUGE_VAL) << "then all is quiet";
  }
}

// Nothing is fetched in the wrong direction, and nothing waits.
TEST(Behaviour, BackwardsIsAsGoodAsForwards) {
  for (const double rate : {1.0, -1.0, 2.0, -2.0}) {
    Player p(good_link(), {});
    p.play_from(5, rate);
    p.run(2.2);
    EXPECT_EQ(p.state().waits, 0u) << rate;
    EXPECT_EQ(p.state().motion, uint32_t{L4D_MOTION_PLAYING});
    const double moved = (p.state().anchor_time - 5) / rate;
    EXPECT_GT(moved, 1.5) << rate;
    const double ahead = rate > 0 ? p.state().ready_until - p.state().anchor_time
                                  : p.state().anchor_time - p.state().ready_from;
    EXPECT_GT(ahead, 0.5) << rate;
  }
}

// On a link that is little faster than the stream, what is shown next has to come first.
TEST(Behaviour, ATightLinkIsEnoughInBothDirections) {
  for (const double rate : {1.0, -1.0}) {
    LinkShape shape = good_link();
    shape.rate = 280e3;
    Player p(shape, {});
    p.play_from(rate > 0 ? 1 : 9, rate);
    p.run(12);
    EXPECT_EQ(p.state().waits, 0u) << rate;
    EXPECT_EQ(p.state().motion, uint32_t{L4D_MOTION_ENDED}) << rate;
  }
}

TEST(Behaviour, ALoopDoesNotWaitAtItsBegin) {
  for (const uint32_t mode : {L4D_PLAY_LOOP, L4D_PLAY_PING_PONG}) {
    Player p(good_link(), {});
    p.run(1);
    p.engine().set_range(p.now(), mode, 2, 4);
    p.play_from(2.5, 1);
    p.run(9);
    EXPECT_EQ(p.state().waits, 0u) << mode;
    EXPECT_GE(p.count(L4D_EVENT_WRAPPED), 4u) << mode;
    EXPECT_GE(p.state().anchor_time, 2);
    EXPECT_LE(p.state().anchor_time, 4);
    const uint64_t received = p.state().received_bytes;
    p.run(20);
    EXPECT_EQ(p.state().received_bytes, received) << "all of the loop is here";
  }
}

// A server that is silent for a while costs one wait, and says so.
TEST(Behaviour, ASilentServer) {
  Faults faults;
  faults.down_from = 0.9;
  faults.down_until = 40;
  LinkShape shape = good_link();
  shape.rate = 200e3;
  l4d_playback_options options{};
  options.ahead = 3;
  Player p(shape, faults, options);
  p.play_from(0, 1);
  p.run(39);
  EXPECT_EQ(p.state().stream, uint32_t{L4D_STREAM_DEGRADED});
  EXPECT_EQ(p.count(L4D_EVENT_SOURCE_DOWN), 1u);
  EXPECT_EQ(p.state().motion, uint32_t{L4D_MOTION_WAITING});
  EXPECT_LT(p.state().requests, 40u) << "one probe at a time";
  // A probe that was on its way, and the delay until the next one.
  while (p.now() < 54 && p.state().motion != L4D_MOTION_PLAYING) p.run(0.5);
  EXPECT_EQ(p.state().stream, uint32_t{L4D_STREAM_OPEN});
  EXPECT_EQ(p.count(L4D_EVENT_SOURCE_UP), 1u);
  EXPECT_EQ(p.state().motion, uint32_t{L4D_MOTION_PLAYING});
  EXPECT_LE(p.state().waits, 2u);
}

// A machine that sleeps for an hour while it plays: its requests have failed, but the source is not
// down, and playback goes on at once.
TEST(Behaviour, AMachineThatSleeps) {
  LinkShape shape = good_link();
  shape.rate = 280e3;
  Player p(shape, {});
  p.play_from(2, 1);
  while (p.state().motion != L4D_MOTION_PLAYING && p.now() < 10) p.run(0.1);
  p.run(0.3);
  ASSERT_EQ(p.state().motion, uint32_t{L4D_MOTION_PLAYING});
  const double time = p.state().anchor_time;
  p.sleep(3600);
  EXPECT_EQ(p.count(L4D_EVENT_LATE), 1u);
  EXPECT_EQ(p.count(L4D_EVENT_SOURCE_DOWN), 0u);
  EXPECT_LT(p.state().anchor_time, time + 6) << "what is not here is not shown";
  p.run(2.5);
  EXPECT_EQ(p.state().motion, uint32_t{L4D_MOTION_PLAYING});
  EXPECT_LE(p.state().waits, 1u);
}

// A pool of a megabyte for a file of more: what is passed goes, and playback goes on.
TEST(Behaviour, ASmallPoolHoldsWhatIsAhead) {
  l4d_playback_options options{};
  options.byte_pool_bytes = Blocks::kSlabBytes;
  Player p(good_link(), {}, options);
  p.play_from(0, 1);
  p.run(12);
  EXPECT_EQ(p.state().motion, uint32_t{L4D_MOTION_ENDED});
  EXPECT_EQ(p.state().waits, 0u);
  EXPECT_GT(long_file().size(), Blocks::kSlabBytes);
  EXPECT_GT(p.engine().blocks().num_evicted(), 0u);
  EXPECT_LT(p.state().received_bytes, 1.3 * static_cast<double>(long_file().size()));
}

// What comes before the first picture is what it needs.
TEST(Behaviour, TheFirstPictureHasTheLinkForItself) {
  const auto bytes_to_picture = [](uint32_t network) {
    LinkShape shape = good_link();
    shape.rate = 300e3;
    Player p(shape, {});
    l4d_quality quality = L4D_INIT(l4d_quality);
    quality.network = network;
    p.engine().set_quality(0, quality);
    p.play_from(4.25, 1);
    while (p.state().ready == 0 && p.now() < 20) p.run(0.01);
    EXPECT_EQ(p.state().ready, 1u);
    return static_cast<double>(p.state().received_bytes);
  };
  EXPECT_LT(bytes_to_picture(L4D_NETWORK_ALL), 1.1 * bytes_to_picture(L4D_NETWORK_INSTANT));
}

// The network that the user allows.
TEST(Behaviour, Network) {
  const auto received = [](uint32_t network) {
    Player p(good_link(), {});
    l4d_quality quality = L4D_INIT(l4d_quality);
    quality.network = network;
    p.engine().set_quality(0, quality);
    p.run(5);
    return p.state().received_bytes;
  };
  EXPECT_EQ(received(L4D_NETWORK_NONE), 0u);
  EXPECT_GT(received(L4D_NETWORK_METADATA), 0u);
  EXPECT_GT(received(L4D_NETWORK_INSTANT), received(L4D_NETWORK_METADATA));
  EXPECT_GT(received(L4D_NETWORK_ALL), received(L4D_NETWORK_INSTANT));
}

}  // namespace
}  // namespace l4d::playback::test
