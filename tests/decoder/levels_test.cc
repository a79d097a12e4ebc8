// SPDX-License-Identifier: Apache-2.0
// What a stream asks of a player: the sweep over pages against brute force over instants and
// windows, and the limits of levels.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "libl4dcodec/container/channels.h"
#include "libl4dcodec/container/level_meter.h"
#include "tests/common/random.h"

namespace l4d {
namespace {

using namespace test;

// ---- pages made up -----------------------------------------------------------------------------

struct Pages {
  SceneHeader header;
  struct Entry {
    uint32_t layer, index;
    uint64_t stored_bytes;
    DirectoryPage page;
  };
  std::vector<Entry> directory;
};

// Layers of several levels, pages whose visible intervals are anything, some of them in blocks.
Pages random_pages(uint64_t seed) {
  Random random(seed);
  const auto below = [&](uint32_t n) -> uint64_t { return random.below(n); };
  Pages out;
  SceneHeader& h = out.header;
  h.timeline.time_begin = static_cast<double>(below(100)) - 50;
  h.timeline.num_frames = 1 + static_cast<uint32_t>(below(400));
  h.timeline.fps_num = 30000;
  h.timeline.fps_den = 1001;
  h.sh_degree = static_cast<unsigned>(below(4));
  for (const unsigned level : {0u, 0u, 2u, 5u}) {
    LayerHeader layer;
    layer.level = std::min<unsigned>(level, num_layers(h.timeline.num_frames) - 1);
    layer.permanent = h.layers.empty();
    layer.directory_bits = static_cast<unsigned>(below(4));
    layer.component[L4D_COMPONENT_SCALE].coding = ComponentCodingId::kVq;
    layer.has_entropy = below(4) > 0;
    layer.symbols_per_gaussian = static_cast<unsigned>(below(3) * 20);
    h.layers.push_back(layer);
  }
  for (uint32_t l = 0; l < h.layers.size(); ++l) {
    const LayerHeader& layer = h.layers[l];
    for (uint32_t d = 0; d < num_directory_pages(layer); ++d) {
      Pages::Entry e{l, d, 32 + below(500), {}};
      if (layer.level > 0) e.page.blocks.resize(below(3));
      for (BlockRecord& block : e.page.blocks) {
        block.tables[L4D_COMPONENT_SCALE].num_entries = static_cast<uint32_t>(1 + below(100));
        block.tables[L4D_COMPONENT_SCALE].chunk.stored_bytes = static_cast<uint32_t>(below(1000));
      }
      const uint32_t end = std::min((d + 1) << layer.directory_bits, num_buckets(layer.level));
      for (uint32_t bucket = d << layer.directory_bits; bucket < end; ++bucket) {
        for (uint64_t n = below(4); n > 0; --n) {
          PageRecord r;
          r.bucket = bucket;
          r.num_gaussians = static_cast<uint32_t>(1 + below(1000));
          r.chunk.stored_bytes = static_cast<uint32_t>(1 + below(10000));
          const auto a = static_cast<uint8_t>(below(256)), b = static_cast<uint8_t>(below(256));
          r.visible_begin = below(4) == 0 ? uint8_t{0} : std::min(a, b);
          r.visible_end = below(4) == 0 ? uint8_t{255} : std::max(a, b);
          if (!e.page.blocks.empty())
            r.block = static_cast<uint32_t>(below(static_cast<uint32_t>(e.page.blocks.size())));
          e.page.pages.push_back(r);
        }
      }
      out.directory.push_back(std::move(e));
    }
  }
  return out;
}

LevelMeter measure(const Pages& pages, uint64_t head_bytes = 0) {
  LevelMeter meter(pages.header);
  for (const Pages::Entry& e : pages.directory) {
    meter.add_directory_page(e.layer, e.index, e.stored_bytes,
                             e.page.pages.empty() ? nullptr : &e.page);
  }
  meter.finish(head_bytes);
  return meter;
}

// What is needed, written out from the specification: chunks with the phases at which they are.
struct Chunk {
  PhaseRun run;
  uint64_t gaussians, bytes, memory, symbols;
  bool is_of_instant;  // not directory
};

// E of section 18.2.
uint64_t symbols_of(const SceneHeader& header, const LayerHeader& layer) {
  if (!layer.has_entropy) return 0;
  return layer.symbols_per_gaussian > 0 ? layer.symbols_per_gaussian
                                        : page_channels(header, layer).size();
}

std::vector<Chunk> chunks_of(const Pages& pages) {
  std::vector<Chunk> out;
  const uint64_t numbers = 17 + pages.header.sh_dim();
  for (const Pages::Entry& e : pages.directory) {
    const LayerHeader& layer = pages.header.layers[e.layer];
    const uint64_t stride = uint64_t{1} << (kPhaseBits - bucket_bits(layer.level));
    const uint64_t bucket = uint64_t{e.index} << layer.directory_bits;
    out.push_back(
        {{bucket == 0 ? 0 : (bucket - 1) * stride, kPhaseLast}, 0, e.stored_bytes, 0, 0, false});
    for (size_t b = 0; b < e.page.blocks.size(); ++b) {
      const RcqTableRef& t = e.page.blocks[b].tables[L4D_COMPONENT_SCALE];
      PhaseRun all{~uint64_t{0}, 0};
      for (const PageRecord& r : e.page.pages) {
        const PhaseRun run = needed_phases(pages.header.timeline, layer, r);
        if (r.block != b || run.empty()) continue;
        all = {std::min(all.first, run.first), std::max(all.last, run.last)};
      }
      if (!all.empty()) {
        out.push_back({all, 0, t.chunk.stored_bytes,
                       uint64_t{t.num_entries} * layer.scale_dim() * 4, 0, true});
      }
    }
    for (const PageRecord& r : e.page.pages) {
      const PhaseRun run = needed_phases(pages.header.timeline, layer, r);
      if (run.empty()) continue;
      out.push_back({run, r.num_gaussians, r.chunk.stored_bytes, 4 * numbers * r.num_gaussians,
                     r.num_gaussians * symbols_of(pages.header, layer), true});
    }
  }
  return out;
}

TEST(Conformance, PeaksAreThoseOfBruteForce) {
  for (uint64_t seed = 0; seed < 40; ++seed) {
    const Pages pages = random_pages(seed);
    const LevelMeter meter = measure(pages, 1000);
    const std::vector<Chunk> chunks = chunks_of(pages);
    Peak gaussians, bytes, memory, symbols;
    uint64_t start = 1000;
    const auto raise = [](uint64_t value, uint64_t phase, Peak* peak) {
      if (value > peak->value || (value == peak->value && phase < peak->phase))
        *peak = {value, phase};
    };
    for (const Chunk& at : chunks) {  // sums grow where something is first needed, and nowhere else
      uint64_t g = 0, b = 0, m = 0, s = 0;
      for (const Chunk& c : chunks) {
        if (!c.is_of_instant || at.run.first < c.run.first || at.run.first > c.run.last) continue;
        g += c.gaussians;
        b += c.bytes;
        m += c.memory;
        s += c.symbols;
      }
      raise(g, at.run.first, &gaussians);
      raise(b, at.run.first, &bytes);
      raise(m, at.run.first, &memory);
      raise(s, at.run.first, &symbols);
      if (at.run.first == 0) start += at.bytes;
    }
    SCOPED_TRACE(seed);
    EXPECT_EQ(meter.gaussians().value, gaussians.value);
    EXPECT_EQ(meter.gaussians().phase, gaussians.phase);
    EXPECT_EQ(meter.instant_bytes().value, bytes.value);
    EXPECT_EQ(meter.instant_bytes().phase, bytes.phase);
    EXPECT_EQ(meter.instant_symbols().value, symbols.value);
    EXPECT_EQ(meter.instant_symbols().phase, symbols.phase);
    uint64_t tables = 0;
    for (const LayerHeader& layer : pages.header.layers) tables += layer.has_entropy ? 1u << 19 : 0;
    EXPECT_EQ(meter.memory_bytes().value, tables + memory.value);
    EXPECT_EQ(meter.memory_bytes().phase, memory.phase);
    EXPECT_EQ(meter.start_bytes(), start);
    EXPECT_EQ(meter.table_bytes(), tables);
  }
}

// Every window of phases, from one first need to another.
double brute_force_burst(const Pages& pages, const std::vector<Chunk>& chunks, double rate,
                         uint64_t Chunk::*of = &Chunk::bytes) {
  const double second = sequence_duration(pages.header.timeline) * 0x1p-40;
  double most = 0;
  for (const Chunk& from : chunks) {
    for (const Chunk& to : chunks) {
      if (from.run.first == 0 || from.run.first > to.run.first) continue;
      double bytes = 0;
      for (const Chunk& c : chunks) {
        const bool inside = c.run.first >= from.run.first && c.run.first <= to.run.first;
        if (inside) bytes += static_cast<double>(c.*of);
      }
      const double time = static_cast<double>(to.run.first - from.run.first) * second;
      most = std::max(most, bytes - rate * time);
    }
  }
  return most;
}

TEST(Conformance, LeakyBucketIsThatOfAllWindows) {
  for (uint64_t seed = 100; seed < 112; ++seed) {
    SCOPED_TRACE(seed);
    const Pages pages = random_pages(seed);
    const LevelMeter meter = measure(pages);
    const std::vector<Chunk> chunks = chunks_of(pages);
    for (const uint64_t rate : {0u, 1000u, 20000u, 300000u}) {
      const Burst burst = meter.min_burst(rate);
      const double want = brute_force_burst(pages, chunks, static_cast<double>(rate));
      EXPECT_NEAR(static_cast<double>(burst.amount), std::floor(want), 1) << rate;
      const double symbols =
          brute_force_burst(pages, chunks, static_cast<double>(rate), &Chunk::symbols);
      EXPECT_NEAR(static_cast<double>(meter.min_symbol_burst(rate).amount), std::floor(symbols), 1);
      // The window named is one that takes so much.
      double bytes = 0;
      for (const Chunk& c : chunks) {
        if (c.run.first >= burst.first && c.run.first <= burst.last && c.run.first > 0) {
          bytes += static_cast<double>(c.bytes);
        }
      }
      const double time = meter.seconds(burst.last) - meter.seconds(burst.first);
      EXPECT_NEAR(bytes - static_cast<double>(rate) * time, want, 1) << rate;
    }
    for (const uint64_t burst : {uint64_t{0}, uint64_t{30000}, uint64_t{1} << 40}) {
      const uint64_t rate = meter.min_rate(burst);
      const auto need = [&](uint64_t r) {
        return brute_force_burst(pages, chunks, static_cast<double>(r));
      };
      const double limit = static_cast<double>(burst) + 1;
      if (rate == LevelMeter::kNoRate) {
        EXPECT_GE(need(uint64_t{1} << 62), limit);
        continue;
      }
      EXPECT_LE(need(rate), limit + 1e-3);
      if (rate > 0) {
        EXPECT_GE(need(rate - 1), limit - 1e-3);
      }
    }
  }
}

TEST(Conformance, WithoutPagesNothingIsAskedFor) {
  SceneHeader header;
  header.timeline.num_frames = header.timeline.fps_num = header.timeline.fps_den = 1;
  LevelMeter meter(header);
  meter.finish(77);
  EXPECT_EQ(meter.gaussians().value, 0u);
  EXPECT_EQ(meter.start_bytes(), 77u);
  EXPECT_EQ(meter.min_burst(0).amount, 0u);
  EXPECT_EQ(meter.min_rate(0), 0u);
  EXPECT_EQ(meter.smallest_level(), 1u);
}

// ---- limits ------------------------------------------------------------------------------------

// One page of a layer of level 1 in the third of four buckets: first needed at a quarter of 100 s.
Pages one_page(const PageRecord& record) {
  Pages p;
  p.header.timeline.num_frames = 100;
  p.header.timeline.fps_num = p.header.timeline.fps_den = 1;
  p.header.layers.resize(2);
  p.header.layers[1].level = 1;
  p.header.layers[1].directory_bits = 2;
  p.directory = {{1, 0, 32, {{record}, {}}}};
  p.directory[0].page.pages[0].bucket = 2;
  return p;
}

std::vector<std::string> clauses(const Pages& pages, uint64_t head_bytes = 0, unsigned level = 1) {
  std::vector<std::string> out;
  const LevelMeter meter = measure(pages, head_bytes);
  for (const LimitViolation& e : meter.beyond(level)) {
    out.push_back(std::string(e.clause) + " " + e.message);
  }
  return out;
}

// Each limit by itself: kept when it is reached, broken by one more.
// spec: LEVL-3, LEVL-4, LEVL-5, LEVL-6, LEVL-7, LEVL-8, LEVL-10, LEVL-11
TEST(Levels, EachLimitIsHeld) {
  const LevelLimits limits = level_limits(1, false);
  using Strings = std::vector<std::string>;
  PageRecord r;
  r.num_gaussians = static_cast<uint32_t>(limits.gaussians);
  EXPECT_EQ(clauses(one_page(r)), Strings());
  ++r.num_gaussians;
  EXPECT_EQ(clauses(one_page(r)),
            Strings{"LEVL-3 level 1 (phone): Gaussians needed at 25 s: 100001, "
                    "which is 1 more than the limit of 100000"});
  r.num_gaussians = 1;

  Pages tables = one_page(r);
  for (LayerHeader& layer : tables.header.layers) layer.has_entropy = true;
  tables.header.sh.coding = ComponentCodingId::kVq;
  tables.header.sh.stages.resize(2);
  tables.header.sh.stages[0].num_entries = 65536;
  const uint64_t rest = limits.table_bytes - 2 * (uint64_t{1} << 19) - 65536 * 12;
  tables.header.sh.stages[1].num_entries = static_cast<uint32_t>(rest / 12);
  EXPECT_EQ(clauses(tables), Strings());
  ++tables.header.sh.stages[1].num_entries;
  ASSERT_EQ(clauses(tables).size(), 1u);
  EXPECT_EQ(clauses(tables)[0].rfind("LEVL-4", 0), 0u);

  EXPECT_EQ(clauses(one_page(r), limits.start_bytes - 32), Strings());
  ASSERT_EQ(clauses(one_page(r), limits.start_bytes - 31).size(), 1u);
  EXPECT_EQ(clauses(one_page(r), limits.start_bytes - 31)[0].rfind("LEVL-6", 0), 0u);

  // The page is all that comes at its time, so that it tells the burst as well as the instant.
  r.chunk.stored_bytes = static_cast<uint32_t>(limits.burst_bytes);
  EXPECT_EQ(clauses(one_page(r)), Strings());
  ++r.chunk.stored_bytes;
  ASSERT_EQ(clauses(one_page(r)).size(), 2u);
  EXPECT_EQ(clauses(one_page(r))[0].rfind("LEVL-5", 0), 0u);
  EXPECT_EQ(clauses(one_page(r))[1].rfind("LEVL-7", 0), 0u);
  // Two that follow each other after 25 s, each needed for half of the time: the rate brings the
  // second.
  Pages two = one_page(r);
  two.directory[0].page.pages[0].chunk.stored_bytes = 3 << 20;
  two.directory[0].page.pages.push_back(two.directory[0].page.pages[0]);
  two.directory[0].page.pages[0].visible_end = 127;
  two.directory[0].page.pages[1].visible_begin = 128;
  EXPECT_EQ(clauses(two), Strings());
  EXPECT_EQ(measure(two).instant_bytes().value, 3u << 20);
  EXPECT_EQ(measure(two).min_burst(0).amount, 6u << 20);
  EXPECT_EQ(measure(two).min_burst(10000).amount, (6u << 20) - 375000);

  r.chunk.stored_bytes = 1;
  r.num_gaussians = 80000;
  Pages symbols = one_page(r);
  symbols.header.layers[1].has_entropy = true;
  symbols.header.layers[1].symbols_per_gaussian = 80;
  EXPECT_EQ(measure(symbols).instant_symbols().value, limits.instant_symbols);
  EXPECT_EQ(clauses(symbols), Strings());
  ++symbols.directory[0].page.pages[0].num_gaussians;
  ASSERT_EQ(clauses(symbols).size(), 2u);
  EXPECT_EQ(clauses(symbols)[0].rfind("LEVL-10", 0), 0u);
  EXPECT_EQ(clauses(symbols)[1].rfind("LEVL-11", 0), 0u);

  PageRecord block;
  block.num_gaussians = 1;
  block.block = 0;
  Pages memory = one_page(block);
  memory.directory[0].page.blocks.resize(1);
  RcqTableRef& t = memory.directory[0].page.blocks[0].tables[L4D_COMPONENT_SCALE];
  t.num_entries = static_cast<uint32_t>((limits.memory_bytes - 80) / 16);
  EXPECT_EQ(clauses(memory), Strings());
  ++t.num_entries;
  ASSERT_EQ(clauses(memory).size(), 1u);
  EXPECT_EQ(clauses(memory)[0].rfind("LEVL-8", 0), 0u);
  EXPECT_EQ(measure(memory).smallest_level(), 2u);
}

}  // namespace
}  // namespace l4d
