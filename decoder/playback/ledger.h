// SPDX-License-Identifier: Apache-2.0
// Chunks that arrived wrong, or are lost for now. What is right has no entry here.
#pragma once

#include <cstdint>
#include <vector>

#include "l4d/playback.h"

namespace l4d::playback {

// Seconds until what was lost `losses` times before is asked for again: 10, doubling, at most 300.
double lost_delay(uint32_t losses);

class Ledger {
 public:
  struct Entry {
    uint64_t offset = 0;
    uint64_t size = 0;
    uint64_t hash = 0;    // of the bytes that came last
    uint32_t wrong = 0;   // how often in a row
    uint32_t losses = 0;  // how often it was lost
    uint32_t cause = L4D_CAUSE_NONE;
    bool lost = false;
    double at = 0;        // lost: when it is wanted again; else when it may be requested again
    uint64_t next = 0;    // the byte that a fresh answer replaces next
    uint64_t number = 0;  // of entries ever made
  };

  // Null where nothing is known against the chunk.
  Entry* find(uint64_t offset);
  const Entry* find(uint64_t offset) const { return const_cast<Ledger*>(this)->find(offset); }
  // All bytes of a chunk are here and have a wrong hash. Returns whether it is lost by that.
  bool add_wrong(uint64_t offset, uint64_t size, uint64_t hash, double now);
  // The chunk cannot be had now, or breaks a rule. Returns whether it was never lost before.
  bool lose(uint64_t offset, uint64_t size, uint32_t cause, double now);
  // The chunk is right. Returns whether it was lost before.
  bool set_right(uint64_t offset);
  // What is lost and may be tried again by `now` is wanted again. Returns whether there was such.
  bool expire(double now);
  // All that is lost or waits, at once.
  void retry(double now);
  // Wanted again at once, if it is lost.
  void retry(uint64_t offset, double now);
  // The next time at which something becomes possible, after `now`; infinity: none.
  double next_time(double now) const;
  void clear() { entries_.clear(); }
  const std::vector<Entry>& entries() const { return entries_; }

 private:
  static constexpr size_t kMostEntries = 4096;
  Entry& make(uint64_t offset, uint64_t size);
  void set_lost(Entry* entry, uint32_t cause, double now);

  std::vector<Entry> entries_;  // ascending by offset
  uint64_t numbered_ = 0;
};

}  // namespace l4d::playback
