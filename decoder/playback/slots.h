// SPDX-License-Identifier: Apache-2.0
// Numbered places for things that have a key, in the order in which they were used last. All steps
// but growing take the same time, however many things there are.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace l4d::playback {

class Slots {
 public:
  static constexpr uint32_t kNone = UINT32_MAX;

  // Makes room for `n` more. A failure to allocate changes nothing.
  void grow(uint32_t n);
  void clear();
  bool has_free() const { return free_ != kNone; }
  uint32_t capacity() const { return static_cast<uint32_t>(slots_.size()); }
  uint32_t size() const { return size_; }
  uint64_t memory_bytes() const {
    return slots_.capacity() * sizeof(Slot) + table_.capacity() * sizeof(uint32_t);
  }

  uint32_t find(uint64_t key) const { return table_.empty() ? kNone : table_[place_of(key)]; }
  // has_free(), and the key is not there. It is the one used last.
  uint32_t insert(uint64_t key);
  void remove(uint32_t slot);
  void use(uint32_t slot);
  uint64_t key(uint32_t slot) const { return slots_[slot].key; }
  // By last use; kNone where there is none.
  uint32_t oldest() const { return back_; }
  uint32_t newest() const { return front_; }
  uint32_t next_newer(uint32_t slot) const { return slots_[slot].before; }
  uint32_t next_older(uint32_t slot) const { return slots_[slot].after; }

 private:
  struct Slot {
    uint64_t key = 0;
    uint32_t before = kNone, after = kNone;  // by last use; `after` also links free slots
  };
  size_t place_of(uint64_t key) const;  // in table_: of the key, or the free one
  void link_front(uint32_t slot);
  void unlink(uint32_t slot);

  std::vector<Slot> slots_;
  std::vector<uint32_t> table_;  // slots, by a hash of the key; at most half full
  uint32_t front_ = kNone, back_ = kNone, free_ = kNone;
  uint32_t size_ = 0;
};

}  // namespace l4d::playback
