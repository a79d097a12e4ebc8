// SPDX-License-Identifier: Apache-2.0
#include "decoder/playback/ledger.h"

#include <algorithm>
#include <cmath>

namespace l4d::playback {
namespace {

constexpr double kLostDelay = 10, kMostDelay = 300;
constexpr double kDamagedDelay = 60;
// Before the second and the third time that a chunk whose answers differ is requested again.
constexpr double kSecondDelay = 1, kThirdDelay = 4;

}  // namespace

double lost_delay(uint32_t losses) {
  return std::min(std::ldexp(kLostDelay, static_cast<int>(std::min(losses, 6u))), kMostDelay);
}

Ledger::Entry* Ledger::find(uint64_t offset) {
  const auto it = std::lower_bound(entries_.begin(), entries_.end(), offset,
                                   [](const Entry& e, uint64_t value) { return e.offset < value; });
  return it == entries_.end() || it->offset != offset ? nullptr : &*it;
}

Ledger::Entry& Ledger::make(uint64_t offset, uint64_t size) {
  if (Entry* const known = find(offset)) {
    // Another version of the file has another chunk there.
    if (known->size != size) {
      known->size = size;
      known->wrong = 0;
      known->next = offset;
    }
    return *known;
  }
  if (entries_.size() >= kMostEntries) {
    entries_.erase(
        std::min_element(entries_.begin(), entries_.end(),
                         [](const Entry& a, const Entry& b) { return a.number < b.number; }));
  }
  const auto it = std::lower_bound(entries_.begin(), entries_.end(), offset,
                                   [](const Entry& e, uint64_t value) { return e.offset < value; });
  Entry entry;
  entry.offset = entry.next = offset;
  entry.size = size;
  entry.number = numbered_++;
  return *entries_.insert(it, entry);
}

void Ledger::set_lost(Entry* entry, uint32_t cause, double now) {
  entry->lost = true;
  entry->cause = cause;
  ++entry->losses;
  const bool lasting = cause == L4D_CAUSE_DAMAGED || cause == L4D_CAUSE_CORRUPT;
  if (lasting) {
    // The file itself is wrong: only another version of it helps.
    entry->at = entry->losses > 1 ? HUGE_VAL : now + kDamagedDelay;
    return;
  }
  entry->at = now + lost_delay(entry->losses - 1);
}

bool Ledger::add_wrong(uint64_t offset, uint64_t size, uint64_t hash, double now) {
  Entry& entry = make(offset, size);
  const bool same = entry.wrong > 0 && entry.hash == hash;
  entry.hash = hash;
  entry.next = offset;
  ++entry.wrong;
  entry.lost = false;
  if (same) {
    set_lost(&entry, L4D_CAUSE_DAMAGED, now);
  } else if (entry.wrong > 3) {
    set_lost(&entry, L4D_CAUSE_GARBLED, now);
  } else {
    entry.at = now + (entry.wrong == 1 ? 0 : entry.wrong == 2 ? kSecondDelay : kThirdDelay);
  }
  return entry.lost;
}

bool Ledger::lose(uint64_t offset, uint64_t size, uint32_t cause, double now) {
  Entry& entry = make(offset, size);
  if (entry.lost) return false;
  set_lost(&entry, cause, now);
  return entry.losses == 1;
}

bool Ledger::set_right(uint64_t offset) {
  Entry* const entry = find(offset);
  if (entry == nullptr) return false;
  const bool was_lost = entry->losses > 0;
  entries_.erase(entries_.begin() + (entry - entries_.data()));
  return was_lost;
}

bool Ledger::expire(double now) {
  bool some = false;
  for (Entry& entry : entries_) {
    if (!entry.lost || entry.at > now) continue;
    entry.lost = false;
    some = true;
  }
  return some;
}

void Ledger::retry(double now) {
  for (Entry& entry : entries_) {
    entry.lost = false;
    entry.at = std::min(entry.at, now);
    entry.wrong = 0;
  }
}

void Ledger::retry(uint64_t offset, double now) {
  Entry* const entry = find(offset);
  if (entry == nullptr || !entry->lost) return;
  entry->lost = false;
  entry->at = now;
}

double Ledger::next_time(double now) const {
  double next = HUGE_VAL;
  for (const Entry& entry : entries_) {
    if (entry.at > now) next = std::min(next, entry.at);
  }
  return next;
}

}  // namespace l4d::playback
