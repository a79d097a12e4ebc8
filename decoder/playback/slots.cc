// SPDX-License-Identifier: Apache-2.0
#include "decoder/playback/slots.h"

#include <algorithm>

namespace l4d::playback {
namespace {

// Keys often follow each other: a multiplication spreads them.
uint64_t spread(uint64_t key) { return (key * 0x9e3779b97f4a7c15u) >> 20; }

}  // namespace

size_t Slots::place_of(uint64_t key) const {
  const size_t mask = table_.size() - 1;
  size_t at = static_cast<size_t>(spread(key)) & mask;
  while (table_[at] != kNone && slots_[table_[at]].key != key) at = (at + 1) & mask;
  return at;
}

void Slots::link_front(uint32_t slot) {
  slots_[slot].before = kNone;
  slots_[slot].after = front_;
  if (front_ != kNone) slots_[front_].before = slot;
  front_ = slot;
  if (back_ == kNone) back_ = slot;
}

void Slots::unlink(uint32_t slot) {
  const Slot& s = slots_[slot];
  (s.before == kNone ? front_ : slots_[s.before].after) = s.after;
  (s.after == kNone ? back_ : slots_[s.after].before) = s.before;
}

void Slots::use(uint32_t slot) {
  if (front_ == slot) return;
  unlink(slot);
  link_front(slot);
}

void Slots::grow(uint32_t n) {
  const size_t before = slots_.size(), after = before + n;
  size_t places = std::max<size_t>(table_.size(), 16);
  while (places < 2 * after) places *= 2;
  std::vector<uint32_t> table;
  if (places > table_.size()) table.assign(places, kNone);
  slots_.resize(after);
  for (size_t slot = after; slot > before; --slot) {
    slots_[slot - 1].after = free_;
    free_ = static_cast<uint32_t>(slot - 1);
  }
  if (table.empty()) return;
  table_.swap(table);
  for (uint32_t slot = front_; slot != kNone; slot = slots_[slot].after) {
    table_[place_of(slots_[slot].key)] = slot;
  }
}

void Slots::clear() {
  slots_.clear();
  table_.clear();
  front_ = back_ = free_ = kNone;
  size_ = 0;
}

uint32_t Slots::insert(uint64_t key) {
  const uint32_t slot = free_;
  free_ = slots_[slot].after;
  slots_[slot].key = key;
  table_[place_of(key)] = slot;
  link_front(slot);
  ++size_;
  return slot;
}

void Slots::remove(uint32_t slot) {
  // What a search would not find any more moves into the place that becomes free.
  const size_t mask = table_.size() - 1;
  size_t hole = place_of(slots_[slot].key);
  for (size_t at = (hole + 1) & mask; table_[at] != kNone; at = (at + 1) & mask) {
    const size_t home = static_cast<size_t>(spread(slots_[table_[at]].key)) & mask;
    if (((at - home) & mask) < ((at - hole) & mask)) continue;
    table_[hole] = table_[at];
    hole = at;
  }
  table_[hole] = kNone;
  unlink(slot);
  slots_[slot].after = free_;
  free_ = slot;
  --size_;
}

}  // namespace l4d::playback
