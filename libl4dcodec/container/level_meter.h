// SPDX-License-Identifier: Apache-2.0
// What playing a stream asks of a decoder and of the link it reads from, computed from headers
// and directory alone, and held against the limits of a level (spec: section 18).
#pragma once

#include <string>
#include <vector>

#include "libl4dcodec/container/directory.h"
#include "libl4dcodec/container/levels.h"

namespace l4d {

// An inclusive run of phases; empty where last < first.
struct PhaseRun {
  uint64_t first = 1;
  uint64_t last = 0;
  bool empty() const { return last < first; }
};

// When a page is needed. Contains the phase of every time whose query selects the page.
PhaseRun needed_phases(const l4d_timeline& timeline, const LayerHeader& layer,
                       const PageRecord& record);

// The largest value over all phases, and the first phase that has it.
struct Peak {
  uint64_t value = 0;
  uint64_t phase = 0;
};

// The run of phases in which more is first needed than a rate brings, by `amount`, the most of all
// runs.
struct Burst {
  uint64_t amount = 0;
  uint64_t first = 0, last = 0;
};

// A limit of a level that a stream goes beyond.
struct LimitViolation {
  const char* clause;
  std::string message;
};

class LevelMeter {
 public:
  // What it holds for each page and block of pages, and for each directory page.
  static constexpr uint64_t kBytesPerPage = 2 * 40 + 24;
  static constexpr uint64_t kBytesPerDirectoryPage = 24;
  // No rate is high enough.
  static constexpr uint64_t kNoRate = ~uint64_t{0};

  // header outlives this.
  explicit LevelMeter(const SceneHeader& header) : header_(header) {}

  // Every directory page in any order, null where it is empty. stored_bytes: of its page table
  // entry and of itself.
  void add_directory_page(uint32_t layer, uint32_t index, uint64_t stored_bytes,
                          const DirectoryPage* page);
  // After the last of them. head_bytes: of the file header and the scene header.
  void finish(uint64_t head_bytes);

  const Peak& gaussians() const { return gaussians_; }
  const Peak& instant_bytes() const { return instant_bytes_; }
  const Peak& instant_symbols() const { return instant_symbols_; }
  // Tables included.
  const Peak& memory_bytes() const { return memory_bytes_; }
  uint64_t table_bytes() const { return table_bytes_; }
  uint64_t start_bytes() const { return start_bytes_; }
  // Of stored bytes, and of symbols.
  Burst min_burst(uint64_t bytes_per_second) const {
    return min_burst(&Arrival::bytes, bytes_per_second);
  }
  uint64_t min_rate(uint64_t burst_bytes) const { return min_rate(&Arrival::bytes, burst_bytes); }
  Burst min_symbol_burst(uint64_t symbols_per_second) const {
    return min_burst(&Arrival::symbols, symbols_per_second);
  }
  uint64_t min_symbol_rate(uint64_t burst_symbols) const {
    return min_rate(&Arrival::symbols, burst_symbols);
  }

  double seconds(uint64_t phase) const;
  // level: 1..kNumConformanceLevels.
  std::vector<LimitViolation> beyond(unsigned level) const;
  // The smallest level that the stream keeps to, 0 if none.
  unsigned smallest_level() const;

 private:
  // What is held from a phase on, or no longer.
  struct Change {
    uint64_t phase;
    int64_t gaussians, bytes, memory, symbols;
  };
  struct Arrival {
    uint64_t phase;
    uint64_t bytes, symbols;
  };
  struct Needs {
    uint64_t gaussians, bytes, memory, symbols;
  };
  void add(const PhaseRun& run, const Needs& needs);
  Burst min_burst(uint64_t Arrival::*of, uint64_t per_second) const;
  uint64_t min_rate(uint64_t Arrival::*of, uint64_t burst) const;
  bool lossless() const { return profile_violation(header_, ProfileId::kLossless).empty(); }
  double seconds_per_phase() const;

  const SceneHeader& header_;
  std::vector<Change> changes_;
  std::vector<Arrival> arrivals_;  // finished: by phase, one for each, without phase 0
  Peak gaussians_, instant_bytes_, memory_bytes_, instant_symbols_;
  uint64_t table_bytes_ = 0;
  uint64_t start_bytes_ = 0;
};

}  // namespace l4d
