// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/container/level_meter.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "libl4dcodec/container/channels.h"
#include "libl4dcodec/entropy/rans_kernels.h"
#include "libl4dcodec/scene/layers.h"

namespace l4d {
namespace {

constexpr uint64_t kEntropyBytes = uint64_t{kMaxEntropyTables} * kRansSlots * sizeof(uint32_t);

// Phases of the buckets for which a bucket is read: itself and its neighbours.
PhaseRun bucket_phases(unsigned level, uint32_t bucket) {
  const int shift = kPhaseBits - bucket_bits(level);
  const uint64_t first = bucket == 0 ? 0 : bucket - 1;
  const uint64_t last = std::min(bucket + 1, num_buckets(level) - 1);
  return {first << shift, ((last + 1) << shift) - 1};
}

struct Codebooks {
  uint64_t stored = 0, decoded = 0;

  void add(const StageCoding& stage, uint32_t dim) {
    stored += stage.codebook.stored_bytes;
    decoded += uint64_t{stage.num_entries} * dim * sizeof(float);
  }
  void add(const ComponentCoding& c, uint32_t dim) {
    for (size_t s = 0; s < c.num_codebooks(); ++s) add(c.codebook(s), dim);
    if (c.has_rcq) add(c.rcq, dim);
  }
};

Codebooks all_codebooks(const SceneHeader& header) {
  Codebooks codebooks;
  codebooks.add(header.sh, header.sh_dim());
  for (const LayerHeader& layer : header.layers) {
    for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
      codebooks.add(layer.component[c], header.component_dim(layer, c));
    }
    if (!layer.has_entropy) continue;
    codebooks.stored += layer.entropy.stored_bytes;
    codebooks.decoded += kEntropyBytes;
  }
  return codebooks;
}

// To the microsecond, with a point whatever the locale. Times of a timeline are below 2^61.
std::string seconds_text(double seconds) {
  constexpr int64_t kMicro = 1000000;
  const double magnitude = std::fabs(seconds);
  auto whole = static_cast<int64_t>(magnitude);
  int64_t micro = std::llround((magnitude - static_cast<double>(whole)) * kMicro);
  whole += micro / kMicro;
  micro %= kMicro;
  std::string text = (seconds < 0 ? "-" : "") + std::to_string(whole);
  if (micro != 0) {
    std::string digits = std::to_string(kMicro + micro).substr(1);
    text += "." + digits.substr(0, digits.find_last_not_of('0') + 1);
  }
  return text + " s";
}

}  // namespace

PhaseRun needed_phases(const l4d_timeline& timeline, const LayerHeader& layer,
                       const PageRecord& record) {
  PhaseRun run = bucket_phases(layer.level, record.bucket);
  if (layer.permanent) return run;
  const double center = bucket_center(timeline, layer.level, record.bucket);
  const double unit = bucket_width(timeline, layer.level) / 64;
  if (record.visible_begin > 0) {
    const double begin = center + (record.visible_begin - 128) * unit;
    if (begin > timeline.time_begin + sequence_duration(timeline)) return {};
    run.first = std::max(run.first, phase_of_time(timeline, begin));
  }
  if (record.visible_end < 255) {
    const double end = center + (record.visible_end - 128) * unit;
    if (end < timeline.time_begin) return {};
    run.last = std::min(run.last, phase_of_time(timeline, end));
  }
  return run;
}

void LevelMeter::add(const PhaseRun& run, const Needs& needs) {
  if (run.empty()) return;
  const auto g = static_cast<int64_t>(needs.gaussians);
  const auto b = static_cast<int64_t>(needs.bytes);
  const auto m = static_cast<int64_t>(needs.memory);
  const auto s = static_cast<int64_t>(needs.symbols);
  changes_.push_back({run.first, g, b, m, s});
  changes_.push_back({run.last + 1, -g, -b, -m, -s});
  arrivals_.push_back({run.first, needs.bytes, needs.symbols});
}

void LevelMeter::add_directory_page(uint32_t layer_index, uint32_t index, uint64_t stored_bytes,
                                    const DirectoryPage* page) {
  const LayerHeader& layer = header_.layers[layer_index];
  const uint32_t first_bucket = index << layer.directory_bits;
  arrivals_.push_back({bucket_phases(layer.level, first_bucket).first, stored_bytes, 0});
  if (page == nullptr) return;
  const uint64_t numbers = 17 + header_.sh_dim();
  const uint64_t symbols = most_symbols(header_, layer);
  std::vector<PhaseRun> blocks(page->blocks.size());
  for (const PageRecord& record : page->pages) {
    const PhaseRun run = needed_phases(header_.timeline, layer, record);
    if (run.empty()) continue;
    const uint64_t n = record.num_gaussians;
    add(run, {n, uint64_t{record.chunk.stored_bytes} + record.sh_detail.stored_bytes,
              n * numbers * sizeof(float), n * symbols});
    if (record.block == kNoBlock) continue;
    PhaseRun& block = blocks[record.block];
    block = block.empty()
                ? run
                : PhaseRun{std::min(block.first, run.first), std::max(block.last, run.last)};
  }
  for (size_t b = 0; b < blocks.size(); ++b) {
    Codebooks codebooks;
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      const RcqTableRef& table = page->blocks[b].tables[c];
      if (table.num_entries == 0) continue;
      codebooks.stored += table.chunk.stored_bytes;
      codebooks.decoded +=
          uint64_t{table.num_entries} * header_.component_dim(layer, c) * sizeof(float);
    }
    add(blocks[b], {0, codebooks.stored, codebooks.decoded, 0});
  }
}

void LevelMeter::finish(uint64_t head_bytes) {
  const Codebooks codebooks = all_codebooks(header_);
  table_bytes_ = codebooks.decoded;
  start_bytes_ = head_bytes + codebooks.stored;

  std::sort(changes_.begin(), changes_.end(),
            [](const Change& a, const Change& b) { return a.phase < b.phase; });
  const auto raise = [](uint64_t phase, int64_t value, Peak* peak) {
    if (static_cast<uint64_t>(value) > peak->value) *peak = {static_cast<uint64_t>(value), phase};
  };
  Change now{};
  for (size_t i = 0; i < changes_.size();) {
    const uint64_t phase = changes_[i].phase;
    for (; i < changes_.size() && changes_[i].phase == phase; ++i) {
      now.gaussians += changes_[i].gaussians;
      now.bytes += changes_[i].bytes;
      now.memory += changes_[i].memory;
      now.symbols += changes_[i].symbols;
    }
    raise(phase, now.gaussians, &gaussians_);
    raise(phase, now.bytes, &instant_bytes_);
    raise(phase, now.memory, &memory_bytes_);
    raise(phase, now.symbols, &instant_symbols_);
  }
  memory_bytes_.value += table_bytes_;

  std::sort(arrivals_.begin(), arrivals_.end(),
            [](const Arrival& a, const Arrival& b) { return a.phase < b.phase; });
  size_t kept = 0;
  for (const Arrival& a : arrivals_) {
    if (a.phase == 0) {
      start_bytes_ += a.bytes;
    } else if (kept > 0 && arrivals_[kept - 1].phase == a.phase) {
      arrivals_[kept - 1].bytes += a.bytes;
      arrivals_[kept - 1].symbols += a.symbols;
    } else {
      arrivals_[kept++] = a;
    }
  }
  arrivals_.resize(kept);
}

double LevelMeter::seconds_per_phase() const {
  return sequence_duration(header_.timeline) * 0x1p-40;
}

double LevelMeter::seconds(uint64_t phase) const {
  return header_.timeline.time_begin + static_cast<double>(phase) * seconds_per_phase();
}

// A bucket that leaks at the rate: how full it ever gets is what it has to hold.
Burst LevelMeter::min_burst(uint64_t Arrival::*of, uint64_t per_second) const {
  const double per_phase = static_cast<double>(per_second) * seconds_per_phase();
  Burst most;
  double fill = 0, highest = 0;
  uint64_t first = 0, last = 0;
  for (const Arrival& a : arrivals_) {
    fill -= per_phase * static_cast<double>(a.phase - last);
    if (!(fill > 0)) {
      fill = 0;
      first = a.phase;
    }
    fill += static_cast<double>(a.*of);
    last = a.phase;
    if (fill <= highest) continue;
    highest = fill;
    most = {static_cast<uint64_t>(fill), first, last};
  }
  return most;
}

uint64_t LevelMeter::min_rate(uint64_t Arrival::*of, uint64_t burst) const {
  const auto enough = [&](uint64_t rate) { return min_burst(of, rate).amount <= burst; };
  uint64_t high = uint64_t{1} << 62;
  if (!enough(high)) return kNoRate;
  if (enough(0)) return 0;
  for (uint64_t low = 0; high - low > 1;) {
    const uint64_t middle = low + (high - low) / 2;
    (enough(middle) ? high : low) = middle;
  }
  return high;
}

std::vector<LimitViolation> LevelMeter::beyond(unsigned level) const {
  const LevelLimits limits = level_limits(level, lossless());
  const std::string name = "level " + std::to_string(level) + " (" + limits.name + "): ";
  std::vector<LimitViolation> found;
  const auto hold = [&](const char* clause, uint64_t value, uint64_t limit,
                        const std::string& what) {
    if (value <= limit) return;
    found.push_back({clause, name + what + ": " + std::to_string(value) + ", which is " +
                                 std::to_string(value - limit) + " more than the limit of " +
                                 std::to_string(limit)});
  };
  const auto at = [&](const Peak& peak) { return " at " + seconds_text(seconds(peak.phase)); };
  hold("LEVL-3", gaussians_.value, limits.gaussians, "Gaussians needed" + at(gaussians_));
  hold("LEVL-4", table_bytes_, limits.table_bytes, "bytes of codebooks and entropy tables");
  hold("LEVL-5", instant_bytes_.value, limits.instant_bytes,
       "bytes of pages needed" + at(instant_bytes_));
  hold("LEVL-6", start_bytes_, limits.start_bytes, "bytes needed before the first instant");
  const Burst burst = min_burst(limits.bytes_per_second);
  const auto during = [&](const Burst& b) {
    return " first needed from " + seconds_text(seconds(b.first)) + " to " +
           seconds_text(seconds(b.last)) + " beyond ";
  };
  hold("LEVL-7", burst.amount, limits.burst_bytes,
       "bytes" + during(burst) + std::to_string(limits.bytes_per_second) + " a second");
  hold("LEVL-8", memory_bytes_.value, limits.memory_bytes, "bytes of memory" + at(memory_bytes_));
  hold("LEVL-10", instant_symbols_.value, limits.instant_symbols,
       "symbols of pages needed" + at(instant_symbols_));
  const Burst symbols = min_symbol_burst(limits.symbols_per_second);
  hold("LEVL-11", symbols.amount, limits.instant_symbols,
       "symbols" + during(symbols) + std::to_string(limits.symbols_per_second) + " a second");
  return found;
}

unsigned LevelMeter::smallest_level() const {
  for (unsigned level = 1; level <= kNumConformanceLevels; ++level) {
    if (beyond(level).empty()) return level;
  }
  return 0;
}

}  // namespace l4d
