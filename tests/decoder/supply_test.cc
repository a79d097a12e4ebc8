// SPDX-License-Identifier: Apache-2.0
// Plan and supply (stream.h): whatever the order and the pieces in which the bytes of a file
// arrive, slices are those of the whole file, and the plan names what they lack and little else.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "l4d/stream.h"
#include "tests/common/codec.h"
#include "tests/common/random.h"
#include "tests/common/sh_detail.h"
#include "tests/decoder/allocation_meter.h"
#include "tests/decoder/recording_reader.h"

namespace l4d {
namespace {

using namespace test;

using Ranges = std::vector<l4d_planned_range>;

l4d_plan_query plan_query(double time, double ahead = 0) {
  l4d_plan_query q;
  l4d_plan_query_init(&q);
  q.time = time;
  q.ahead = ahead;
  return q;
}

// A player, and the server that it asks.
class Player {
 public:
  explicit Player(const Bytes& file, bool tolerant = false, uint64_t max_memory = 0,
                  bool knows_size = true)
      : file_(file) {
    l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
    o.tolerant = tolerant;
    o.max_memory_bytes = max_memory;
    decoder_ = DecoderHandle(&o);
    EXPECT_EQ(l4d_decoder_open_supplied(get(), knows_size ? file.size() : 0), L4D_OK);
  }

  l4d_decoder* get() const { return decoder_.get(); }
  DecoderHandle& decoder() { return decoder_; }

  Ranges plan(const l4d_plan_query& query) const {
    uint64_t count = 0;
    decoder_.check(l4d_decoder_plan(get(), &query, nullptr, 0, &count));
    Ranges ranges(count);
    decoder_.check(l4d_decoder_plan(get(), &query, ranges.data(), count, &count));
    EXPECT_EQ(count, ranges.size());
    return ranges;
  }
  std::vector<l4d_time_span> buffered(const l4d_plan_query& query) const {
    uint64_t count = 0;
    decoder_.check(l4d_decoder_get_buffered(get(), &query, nullptr, 0, &count));
    std::vector<l4d_time_span> spans(count);
    decoder_.check(l4d_decoder_get_buffered(get(), &query, spans.data(), count, &count));
    return spans;
  }
  l4d_status supply(uint64_t offset, uint64_t size) {
    if (offset >= file_.size()) return L4D_OK;  // of a file of unknown size
    size = std::min<uint64_t>(size, file_.size() - offset);
    supplied_ += size;
    return l4d_decoder_supply(get(), offset, file_.data() + offset, static_cast<size_t>(size));
  }
  // Supplies a plan until nothing is left of it. Returns how many rounds that took.
  int fill(const l4d_plan_query& query) {
    for (int round = 0; round < 10; ++round) {
      const Ranges ranges = plan(query);
      if (ranges.empty()) return round;
      for (const l4d_planned_range& r : ranges) {
        EXPECT_LE(r.useful_bytes, r.size);
        EXPECT_GT(r.useful_bytes, 0u);
        EXPECT_EQ(supply(r.offset, r.size), L4D_OK);
      }
    }
    ADD_FAILURE() << "the plan does not end";
    return 10;
  }
  // L4D_OK and the slice, or why there is none.
  l4d_status slice(double time, SplatArrays* out) {
    try {
      *out = decoder_.slice(time);
      return L4D_OK;
    } catch (const Error& e) {
      return e.status();
    }
  }
  uint64_t supplied() const { return supplied_; }
  uint64_t memory() const {
    l4d_counters c;
    l4d_counters_init(&c);
    decoder_.check(l4d_decoder_get_counters(get(), &c));
    return c.memory_bytes;
  }

 private:
  const Bytes& file_;
  DecoderHandle decoder_;
  uint64_t supplied_ = 0;
};

SplatArrays whole_slice(const Bytes& file, double time, uint32_t detail = L4D_DETAIL_FULL) {
  DecoderHandle d;
  d.open_memory(file.data(), file.size());
  d.set_detail(detail);
  return d.slice(time);
}

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

class Supplied : public testing::TestWithParam<NamedFile> {};

// What a plan names is what slices need: at every step of the sequence.
TEST_P(Supplied, PlansSuffice) {
  const Bytes& file = GetParam().bytes();
  for (const bool knows_size : {true, false}) {
    Player player(file, false, 0, knows_size);
    SplatArrays got;
    EXPECT_EQ(player.slice(0.3, &got), L4D_ERR_NEED_DATA);
    for (const double t : {0.3, 0.31, 0.7, 1.9, 0.0}) {
      EXPECT_LE(player.fill(plan_query(t)), 4);
      ASSERT_EQ(player.slice(t, &got), L4D_OK) << t;
      EXPECT_TRUE(same_bits(whole_slice(file, t), got)) << t;
    }
    // A window ahead, and one back.
    player.fill(plan_query(0.5, 0.5));
    for (const double t : {0.5, 0.6, 0.75, 1.0}) EXPECT_EQ(player.slice(t, &got), L4D_OK) << t;
    player.fill(plan_query(1.9, -0.4));
    for (const double t : {1.9, 1.7, 1.5}) EXPECT_EQ(player.slice(t, &got), L4D_OK) << t;
  }
}

// All bytes in pieces of any size and in any order: the slices of the whole file, or NEED_DATA
// until the last byte that they need.
TEST_P(Supplied, AnyOrderAndAnyPieces) {
  const Bytes& file = GetParam().bytes();
  const std::vector<double> times = {0.1, 0.9, 1.8};
  std::vector<SplatArrays> want;
  for (const double t : times) want.push_back(whole_slice(file, t));
  const GaussianArrays all = decode(file, all_query());
  for (uint64_t seed = 1; seed <= 6; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    struct Piece {
      uint64_t offset, size;
    };
    std::vector<Piece> pieces;
    for (uint64_t at = 0; at < file.size();) {
      const uint64_t size = 1 + random.below(static_cast<uint32_t>(file.size() / 5));
      pieces.push_back({at, std::min<uint64_t>(size, file.size() - at)});
      at += 1 + random.below(static_cast<uint32_t>(size));  // some overlap
    }
    for (size_t i = pieces.size(); i > 1; --i) {
      std::swap(pieces[i - 1], pieces[random.below(static_cast<uint32_t>(i))]);
    }
    Player player(file);
    size_t waits = 0;
    SplatArrays got;
    for (const Piece& piece : pieces) {
      const size_t k = random.below(static_cast<uint32_t>(times.size()));
      const l4d_status status = player.slice(times[k], &got);
      if (status == L4D_OK) {
        EXPECT_TRUE(same_bits(want[k], got));
      } else {
        EXPECT_EQ(status, L4D_ERR_NEED_DATA);
        EXPECT_FALSE(player.plan(plan_query(times[k])).empty());
        ++waits;
      }
      ASSERT_EQ(player.supply(piece.offset, piece.size), L4D_OK);
    }
    EXPECT_GT(waits, 0u);
    for (size_t k = 0; k < times.size(); ++k) {
      player.fill(plan_query(times[k]));
      ASSERT_EQ(player.slice(times[k], &got), L4D_OK);
      EXPECT_TRUE(same_bits(want[k], got));
    }
    ASSERT_EQ(player.supply(0, file.size()), L4D_OK);
    EXPECT_TRUE(same_bits(all, player.decoder().decode(all_query())));
  }
}

INSTANTIATE_TEST_SUITE_P(
    Streams, Supplied,
    testing::Values(NamedFile{"indexed", dynamic_file}, NamedFile{"staged", staged_file},
                    NamedFile{"rcq", rcq_file}, NamedFile{"transform", transform_file},
                    NamedFile{"split", split_file}, NamedFile{"lossless", lossless_file},
                    NamedFile{"wandering", wandering_file}),
    file_name);

TEST(Supply, RoundsAndBytes) {
  const Bytes& file = minute_file();
  for (const double t : {0.0, 30.0}) {
    Player player(file);
    l4d_plan_query query = plan_query(t);
    query.merge_gap = 0;
    EXPECT_LE(player.fill(query), 4) << "first picture";
    SplatArrays got;
    ASSERT_EQ(player.slice(t, &got), L4D_OK);
    query.time = t + 13;
    EXPECT_LE(player.fill(query), 2) << "seek";
    ASSERT_EQ(player.slice(t + 13, &got), L4D_OK);
    // What a plain reader reads, and the head, tables and directory of all.
    DecoderHandle d;
    d.open_memory(file.data(), file.size());
    (void)d.slice(t);
    (void)d.slice(t + 13);
    l4d_counters c;
    l4d_counters_init(&c);
    d.check(l4d_decoder_get_counters(d.get(), &c));
    EXPECT_LE(player.supplied(), c.bytes_read + 65536 + 512 * 1024);
  }
}

// At gap 0 the pages of a plan are those that a plain reader reads, in playback and over seeks.
TEST(Supply, LittleElseThanWhatIsRead) {
  const Bytes& file = minute_file();
  RecordingReader plain(file);
  DecoderHandle reader;
  reader.open(plain.reader());
  Player player(file);
  std::vector<bool> named(file.size());
  for (const double begin : {0.0, 41.0, 7.5, 58.0, 20.2}) {
    l4d_plan_query query = plan_query(begin, 1.5);
    query.merge_gap = 0;
    for (Ranges ranges = player.plan(query); !ranges.empty(); ranges = player.plan(query)) {
      for (const l4d_planned_range& r : ranges) {
        ASSERT_EQ(player.supply(r.offset, r.size), L4D_OK);
        if (r.kind < L4D_RANGE_BASE) continue;
        std::fill_n(named.begin() + static_cast<ptrdiff_t>(r.offset), r.size, true);
      }
    }
    SplatArrays got;
    for (int i = 0; i <= 45; ++i) {
      const double t = begin + i / 30.0;
      ASSERT_EQ(player.slice(t, &got), L4D_OK);
      EXPECT_TRUE(same_bits(reader.slice(t), got));
    }
  }
  std::vector<bool> read(file.size());
  for (const RecordingReader::Read& r : plain.reads) {
    std::fill_n(read.begin() + static_cast<ptrdiff_t>(r.offset), r.n, true);
  }
  uint64_t pages = 0, more = 0;
  for (size_t i = 0; i < file.size(); ++i) {
    pages += named[i];
    more += named[i] && !read[i];
  }
  EXPECT_GT(pages, 100000u);
  EXPECT_LE(static_cast<double>(more), 0.05 * static_cast<double>(pages));
}

// Without gaps a plan names what is read, and nothing else.
TEST(Supply, NoByteTwice) {
  const Bytes& file = minute_file();
  Player player(file);
  std::vector<int> times_named(file.size());
  l4d_plan_query query = plan_query(3, 5);
  query.merge_gap = 0;
  query.max_range_bytes = 1000;
  for (int round = 0; round < 6; ++round) {
    for (const l4d_planned_range& r : player.plan(query)) {
      EXPECT_EQ(r.useful_bytes, r.size);
      EXPECT_LE(r.size, 1000u);
      for (uint64_t i = r.offset; i < r.offset + r.size; ++i) ++times_named[i];
      ASSERT_EQ(player.supply(r.offset, r.size), L4D_OK);
    }
  }
  EXPECT_TRUE(player.plan(query).empty());
  EXPECT_EQ(*std::max_element(times_named.begin(), times_named.end()), 1);
}

TEST(Supply, UrgentFirst) {
  const Bytes& file = split_file();
  Player player(file);
  player.fill([] {
    l4d_plan_query q = plan_query(0);
    q.max_level = 0;
    return q;
  }());
  const Ranges ranges = player.plan(plan_query(0.1, 1.8));
  ASSERT_GT(ranges.size(), 2u);
  uint32_t kind = L4D_RANGE_BASE;
  double at = -std::numeric_limits<double>::infinity();
  for (const l4d_planned_range& r : ranges) {
    EXPECT_GE(r.kind, kind);
    if (r.kind != kind) at = -std::numeric_limits<double>::infinity();
    EXPECT_GE(r.needed_at, at - 0.5);
    EXPECT_GE(r.needed_at, 0.1);
    EXPECT_LE(r.needed_at, 1.9);
    kind = r.kind;
    at = std::max(at, r.needed_at);
  }
  EXPECT_EQ(kind, static_cast<uint32_t>(L4D_RANGE_DETAIL));
  l4d_plan_query few = plan_query(0.1, 1.8);
  few.max_bytes = 1;
  EXPECT_EQ(player.plan(few).size(), 1u);
  few = plan_query(0.1, 1.8);
  few.detail = L4D_DETAIL_BASE_COLOR;
  for (const l4d_planned_range& r : player.plan(few)) {
    EXPECT_NE(r.kind, static_cast<uint32_t>(L4D_RANGE_DETAIL));
  }
}

// spec: DEC-3
TEST(Supply, MoreDetailNeedsShChunksOnly) {
  const Bytes& file = split_file();
  Player player(file);
  player.decoder().set_detail(L4D_DETAIL_BASE_COLOR);
  l4d_plan_query query = plan_query(0.7);
  query.merge_gap = 0;
  query.detail = L4D_DETAIL_BASE_COLOR;
  player.fill(query);
  SplatArrays got;
  ASSERT_EQ(player.slice(0.7, &got), L4D_OK);
  EXPECT_TRUE(same_bits(whole_slice(file, 0.7, L4D_DETAIL_BASE_COLOR), got));
  player.decoder().set_detail(L4D_DETAIL_FULL);
  EXPECT_EQ(player.slice(0.7, &got), L4D_ERR_NEED_DATA);
  query.detail = L4D_DETAIL_FULL;
  for (const l4d_planned_range& r : player.plan(query)) {
    EXPECT_EQ(r.kind, static_cast<uint32_t>(L4D_RANGE_DETAIL));
  }
  EXPECT_EQ(player.fill(query), 1);
  ASSERT_EQ(player.slice(0.7, &got), L4D_OK);
  EXPECT_TRUE(same_bits(whole_slice(file, 0.7), got));
}

// What is here in full detail serves slices in base colours: no byte is wanted twice.
TEST(Supply, LessDetailNeedsNothing) {
  const Bytes& file = split_file();
  Player player(file);
  player.fill(plan_query(0.7));
  SplatArrays full, base;
  ASSERT_EQ(player.slice(0.7, &full), L4D_OK);
  player.decoder().set_detail(L4D_DETAIL_BASE_COLOR);
  l4d_plan_query query = plan_query(0.7);
  query.detail = L4D_DETAIL_BASE_COLOR;
  EXPECT_TRUE(player.plan(query).empty());
  ASSERT_EQ(player.slice(0.7, &base), L4D_OK);
  EXPECT_TRUE(same_bits(full, base));
  // Buckets that are new show the detail that is set, next to those.
  query.time = 1.9;
  for (const l4d_planned_range& r : player.plan(query)) EXPECT_EQ(r.kind, L4D_RANGE_BASE);
  player.fill(query);
  EXPECT_EQ(player.slice(1.9, &base), L4D_OK);
}

// A tolerant decoder shows more and more, and says what lacks.
TEST(Supply, TolerantShowsWhatIsThere) {
  const Bytes& file = split_file();
  Player player(file, true);
  size_t last = 0, partial = 0;
  bool incomplete = true;
  for (int round = 0; round < 2000 && incomplete; ++round) {
    l4d_plan_query query = plan_query(0.9);
    query.max_bytes = 1;
    query.max_range_bytes = 700;
    query.merge_gap = 0;
    const Ranges ranges = player.plan(query);
    incomplete = !ranges.empty();
    for (const l4d_planned_range& r : ranges) ASSERT_EQ(player.supply(r.offset, r.size), L4D_OK);
    SplatArrays got;
    const l4d_status status = player.slice(0.9, &got);
    if (status != L4D_OK) {
      ASSERT_EQ(status, L4D_ERR_NEED_DATA);  // before the headers
      ASSERT_EQ(last, 0u);
      continue;
    }
    EXPECT_GE(got.count(), last);
    last = got.count();
    uint64_t losses = 0;
    player.decoder().check(l4d_decoder_get_losses(player.get(), nullptr, 0, &losses));
    partial += losses > 0 && last > 0;
    if (!incomplete) {
      EXPECT_EQ(losses, 0u);
      EXPECT_TRUE(same_bits(whole_slice(file, 0.9), got));
    }
  }
  EXPECT_FALSE(incomplete);
  EXPECT_GT(partial, 3u);
}

TEST(Supply, WrongBytesArePlannedOnceMore) {
  const Bytes& file = transform_file();
  Bytes wrong = file;
  for (size_t i = 5000; i < wrong.size(); ++i) wrong[i] ^= 0x55;
  for (const bool forever : {false, true}) {
    SCOPED_TRACE(forever);
    Player player(file);
    l4d_plan_query query = plan_query(1.0);
    SplatArrays got;
    l4d_status status = L4D_ERR_NEED_DATA;
    int rounds = 0;
    std::vector<bool> seen(file.size());
    for (; rounds < 50 && status == L4D_ERR_NEED_DATA; ++rounds) {
      for (const l4d_planned_range& r : player.plan(query)) {
        const uint64_t end = std::min<uint64_t>(r.offset + r.size, file.size());
        Bytes data;
        for (uint64_t i = r.offset; i < end; ++i) {
          data.push_back(forever || !seen[i] ? wrong[i] : file[i]);
          seen[i] = true;
        }
        ASSERT_EQ(l4d_decoder_supply(player.get(), r.offset, data.data(), data.size()), L4D_OK);
      }
      status = player.slice(1.0, &got);
    }
    if (forever) {
      EXPECT_EQ(status, L4D_ERR_CHECKSUM);
    } else {
      EXPECT_EQ(status, L4D_OK);
      EXPECT_TRUE(same_bits(whole_slice(file, 1.0), got));
    }
    EXPECT_LT(rounds, 50);
    EXPECT_GE(rounds, 2);
  }
}

TEST(Supply, MemoryDoesNotGrow) {
  const Bytes& file = minute_file();
  constexpr uint64_t kMaxMemory = 12 << 20;
  Player player(file, false, kMaxMemory);
  Random random(7);
  uint64_t early = 0, late = 0;
  SplatArrays got;
  std::optional<AllocationMeter> meter;
  for (int i = 0; i < 1000; ++i) {
    if (i == 200) meter.emplace();
    const double t = 0.1 * static_cast<double>(random.below(600));
    player.fill(plan_query(t, 0.2));
    ASSERT_EQ(player.slice(t, &got), L4D_OK);
    (i < 200 ? early : late) = std::max(i < 200 ? early : late, player.memory());
  }
  EXPECT_LE(late, early + early / 4);
  EXPECT_LE(late, kMaxMemory);
  // What the program really allocates: at the 200th seek memory is full but for what is at hand.
  EXPECT_LE(meter->peak(), kMaxMemory / 2);
}

TEST(Supply, BufferedSpans) {
  const Bytes& file = minute_file();
  Player player(file);
  const l4d_plan_query minute = plan_query(0, 60);
  EXPECT_TRUE(player.buffered(minute).empty());
  player.fill(plan_query(10, 5));
  const std::vector<l4d_time_span> spans = player.buffered(minute);
  ASSERT_FALSE(spans.empty());
  const auto holds = [&](double t) {
    return std::any_of(spans.begin(), spans.end(),
                       [&](const l4d_time_span& s) { return s.begin <= t && t <= s.end; });
  };
  EXPECT_TRUE(holds(10.0) && holds(12.0) && holds(15.0));
  SplatArrays got;
  size_t shown = 0, refused = 0;
  for (double t = 0.05; t < 60; t += 0.77) {
    const l4d_status status = player.slice(t, &got);
    EXPECT_EQ(status, holds(t) ? L4D_OK : L4D_ERR_NEED_DATA) << t;
    ++(holds(t) ? shown : refused);
  }
  EXPECT_GT(shown, 5u);
  EXPECT_GT(refused, 5u);
}

TEST(Supply, CarelessCalls) {
  const Bytes& file = transform_file();
  const l4d_plan_query query = plan_query(0);
  uint64_t count = 7;
  DecoderHandle plain;
  EXPECT_EQ(l4d_decoder_plan(plain.get(), &query, nullptr, 0, &count), L4D_ERR_INVALID_STATE);
  EXPECT_EQ(l4d_decoder_supply(plain.get(), 0, file.data(), 10), L4D_ERR_INVALID_STATE);
  plain.open_memory(file.data(), file.size());
  EXPECT_EQ(l4d_decoder_plan(plain.get(), &query, nullptr, 0, &count), L4D_ERR_INVALID_STATE);
  EXPECT_EQ(count, 7u);

  Player player(file);
  EXPECT_EQ(l4d_decoder_supply(player.get(), file.size() - 3, file.data(), 4),
            L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_decoder_supply(player.get(), UINT64_MAX, file.data(), 4), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_decoder_supply(player.get(), 0, nullptr, 4), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_decoder_supply(player.get(), 0, nullptr, 0), L4D_OK);
  EXPECT_EQ(l4d_decoder_plan(player.get(), &query, nullptr, 1, &count), L4D_ERR_INVALID_ARGUMENT);
  l4d_plan_query bad = plan_query(std::nan(""));
  EXPECT_EQ(l4d_decoder_plan(player.get(), &bad, nullptr, 0, &count), L4D_ERR_INVALID_ARGUMENT);
  bad = plan_query(0);
  bad.detail = 9;
  EXPECT_EQ(l4d_decoder_plan(player.get(), &bad, nullptr, 0, &count), L4D_ERR_INVALID_ARGUMENT);
  l4d_info info;
  l4d_info_init(&info);
  EXPECT_EQ(l4d_decoder_get_info(player.get(), &info), L4D_ERR_NEED_DATA);
  // What is no stream is refused when its first bytes are here.
  const Bytes junk(100, 'x');
  EXPECT_EQ(l4d_decoder_supply(player.get(), 0, junk.data(), junk.size()), L4D_ERR_NOT_L4D);
  EXPECT_EQ(l4d_decoder_open_supplied(player.get(), file.size()), L4D_OK);
  player.fill(query);
  SplatArrays got;
  EXPECT_EQ(player.slice(0, &got), L4D_OK);
}

}  // namespace
}  // namespace l4d
