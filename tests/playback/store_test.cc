// SPDX-License-Identifier: Apache-2.0
// What the engine asks a store of the caller to hold, and which bytes it needs for that.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "decoder/playback/playback.h"
#include "decoder/read/page_reads.h"
#include "tests/common/codec.h"
#include "tests/playback/decoders.h"
#include "tests/playback/fake_link.h"

namespace l4d::playback::test {
namespace {

using namespace l4d::test;

const Bytes& long_file() {
  static const Bytes kBytes = [] {
    SceneOptions scene;
    scene.count = 12000;
    scene.num_frames = 300;
    scene.permanent = 0.05;
    scene.sh_degree = 3;
    EncodeOptions o;
    o.preset = "default";
    o.rans = true;
    o.settings = {{L4D_ENC_MERGE_COUNT, 40}, {L4D_ENC_PAGE_SIZE, 256}};
    return encode(make_scene(scene), o).bytes;
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

// An engine of a local file, and a store that loads at once.
class Store {
 public:
  Store(const Bytes& bytes, l4d_playback_options options) : options_(options) {
    options_.struct_size = sizeof options_;
    EXPECT_TRUE(resolve(&options_).ok());
    engine_ = std::make_unique<Playback>(options_, decoders_);
    EXPECT_TRUE(engine_->open_reader(0, reader_of(bytes)).ok());
  }
  // Seeks, and does all that there is to do. Returns the event that ends the search.
  uint32_t seek(double time) {
    now_ += 1;
    cause = 0;
    EXPECT_TRUE(engine_->seek(now_, time, 0, 1).ok());
    uint32_t ended = 0;
    for (int round = 0; round < 1000; ++round) {
      engine_->update(now_);
      l4d_playback_item item{};
      bool any = false;
      for (; engine_->take(&item, 1) == 1; any = true) {
        const std::pair<uint32_t, uint32_t> key(item.layer, item.bucket);
        if (item.kind == L4D_ITEM_UNLOAD) {
          EXPECT_EQ(units.erase(key), 1u);
        } else if (item.kind == L4D_ITEM_LOAD) {
          units[key] = item.units;
          ++loads;
          most = std::max(most, held());
          engine_->loaded(now_, item.id, item.units, L4D_OK);
        } else if (item.kind == L4D_ITEM_EVENT && item.event != L4D_EVENT_STREAM) {
          if (item.event == L4D_EVENT_SHOWN || item.event == L4D_EVENT_FAILED) ended = item.event;
          cause = std::max(cause, item.cause);
        }
      }
      check_ready();
      if (!any && ended == L4D_EVENT_SHOWN) expect_ready(std::clamp(time, 0.0, 10.0));
      if (!any) return ended;
    }
    ADD_FAILURE() << "the engine does not come to rest";
    return 0;
  }
  // An instant that is shown is among what is buffered.
  void expect_ready(double time) const {
    std::vector<l4d_time_span> spans;
    engine_->buffered(&spans);
    EXPECT_TRUE(std::any_of(spans.begin(), spans.end(), [time](const l4d_time_span& span) {
      return span.begin <= time && time <= span.end;
    })) << time;
  }
  // What is said to be ready is held.
  void check_ready() const {
    std::vector<l4d_time_span> spans;
    engine_->buffered(&spans);
    for (const l4d_time_span& span : spans) {
      for (const Item& item : items()) {
        if (!item.is_bucket() || item.begin > span.end || item.end < span.begin) continue;
        EXPECT_EQ(units.count({item.layer, item.bucket}), 1u)
            << span.begin << " to " << span.end << " shows " << item.layer << "/" << item.bucket;
      }
    }
  }
  uint64_t held() const {
    uint64_t sum = 0;
    for (const auto& [key, n] : units) sum += n;
    return sum;
  }
  Playback& engine() { return *engine_; }
  Part& part() const { return *engine_->presentation().parts()[0]; }
  const std::vector<Item>& items() const { return part().map.items(); }

  std::map<std::pair<uint32_t, uint32_t>, uint64_t> units;  // of what is loaded
  uint64_t most = 0, loads = 0;
  uint32_t cause = 0;

 private:
  l4d_playback_options options_;
  OwnDecoders decoders_{true};
  std::unique_ptr<Playback> engine_;
  double now_ = 0;
};

l4d_playback_options caller_options() {
  l4d_playback_options o = L4D_INIT(l4d_playback_options);
  o.loader = L4D_LOADER_CALLER;
  o.ahead = o.start_ahead = 0.5;
  return o;
}

TEST(Store, HoldsWhatThePathNeedsIfThereIsNoLimit) {
  Store s(long_file(), caller_options());
  for (int k = 0; k <= 40; ++k) ASSERT_EQ(s.seek(k / 4.0), L4D_EVENT_SHOWN) << k;
  EXPECT_GT(s.units.size(), 1u);
  EXPECT_LT(s.most, 12000u * 2 / 3) << "what has played stays for ever";
}

TEST(Store, KeepsAllThatALimitAllows) {
  l4d_playback_options o = caller_options();
  o.max_units = 1 << 20;
  Store s(long_file(), o);
  for (int k = 0; k <= 40; ++k) ASSERT_EQ(s.seek(k / 4.0), L4D_EVENT_SHOWN) << k;
  EXPECT_GT(s.held(), 11000u);
}

TEST(Store, HoldsTheEndsOfTheSequence) {
  Store s(long_file(), caller_options());
  for (const double time : {10.0, 0.0, 11.0, -1.0}) ASSERT_EQ(s.seek(time), L4D_EVENT_SHOWN);
}

// Base colours first and detail after them would be decoded twice.
TEST(Store, LoadsEachBucketOnceWhereFullDetailIsFixed) {
  l4d_playback_options o = caller_options();
  o.max_units = 1 << 20;
  Store s(long_file(), o);
  l4d_quality quality = L4D_INIT(l4d_quality);
  quality.fixed = 1;
  s.engine().set_quality(0, quality);
  for (int k = 0; k <= 40; ++k) ASSERT_EQ(s.seek(k / 4.0), L4D_EVENT_SHOWN) << k;
  EXPECT_EQ(s.loads, s.units.size());
}

TEST(Store, IsNotReadyForWhatItUnloads) {
  l4d_playback_options o = caller_options();
  o.max_units = 9000;
  Store s(long_file(), o);
  for (int k = 0; k <= 60; ++k) {
    const double time = k % 3 == 0 ? (7 * k) % 100 / 10.0 : k / 10.0;
    ASSERT_EQ(s.seek(time), L4D_EVENT_SHOWN) << time;
  }
  EXPECT_LE(s.most, o.max_units);
}

// An instant that does not fit would be waited for, for ever.
TEST(Store, FailsWhereALimitHoldsNoInstant) {
  l4d_playback_options o = caller_options();
  o.max_units = 1 << 20;
  Store all(long_file(), o);
  all.seek(2);
  // Of the whole path, the instant is the larger part.
  o.max_units = all.held() / 3;
  Store s(long_file(), o);
  EXPECT_EQ(s.seek(2), L4D_EVENT_FAILED);
  EXPECT_EQ(s.cause, L4D_CAUSE_LIMIT);
  EXPECT_EQ(s.engine().state().stream, L4D_STREAM_FAILED);
  EXPECT_EQ(s.seek(7), L4D_EVENT_FAILED) << "a seek tries again";
}

// Else it would be opening until its loss is looked at again.
TEST(Store, KnowsAtOnceThatALocalFileIsNone) {
  const Bytes garbage(1000, 7);
  Store s(garbage, caller_options());
  EXPECT_EQ(s.seek(1), L4D_EVENT_FAILED);
  EXPECT_EQ(s.engine().state().stream, L4D_STREAM_FAILED);
  EXPECT_EQ(s.engine().state().cause, L4D_CAUSE_NOT_L4D);
}

// Spans are closed: what is said to be ready at their ends is.
TEST(Store, TellsWhatIsReadyToTheEnds) {
  l4d_playback_options o = caller_options();
  o.max_units = 1 << 20;
  Store s(long_file(), o);
  s.seek(5);
  std::vector<l4d_time_span> spans;
  s.engine().buffered(&spans);
  ASSERT_FALSE(spans.empty());
  for (const l4d_time_span& span : spans) {
    for (const double end : {span.begin, span.end}) {
      for (const Item& item : s.items()) {
        EXPECT_FALSE(item.hidden <= s.engine().state().rung && item.is_visible(end)) << end;
      }
    }
  }
}

// The engine need not hold what lies between pages, however near they are.
TEST(Store, NeedsNoBytesBetweenPages) {
  Store s(long_file(), caller_options());
  ASSERT_EQ(s.seek(1), L4D_EVENT_SHOWN);
  const Plan plan;
  EXPECT_EQ(max_read_gap(s.part().decoder.file().source(), plan, true), 0u);
  EXPECT_GT(max_read_gap(ByteSource(), plan, true), 0u);
}

// Nothing plays, and nobody calls without need: the rungs come one after the other anyway.
TEST(Store, APausedPictureGetsAllThatTheLinkCarries) {
  l4d_playback_options o = L4D_INIT(l4d_playback_options);
  ASSERT_TRUE(resolve(&o).ok());
  OwnDecoders decoders(true);
  Playback engine(o, decoders);
  LinkShape shape;
  shape.rate = 1e9;
  shape.delay = 0.001;
  OneFile content(long_file(), long_file(), 1e300);
  FakeLink link(content, shape, {}, 1);
  engine.open(0, "", L4D_OPEN_STREAM, long_file().size());
  ASSERT_TRUE(engine.seek(0, 5, 0, 1).ok());
  for (double now = 0; now < 3;) {
    engine.update(now);
    l4d_playback_item item{};
    while (engine.take(&item, 1) == 1) {
      if (item.kind == L4D_ITEM_REQUEST) link.request(now, item);
    }
    now = std::min(link.next_time(), engine.state().wake_at);
    if (link.next_time() <= now) link.step(now, &engine);
  }
  EXPECT_EQ(engine.state().num_rungs, 2u);
  EXPECT_EQ(engine.state().rung, 1u);
}

}  // namespace
}  // namespace l4d::playback::test
