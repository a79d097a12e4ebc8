// SPDX-License-Identifier: Apache-2.0
// Which time buckets lie in which chunks of a store: the bookkeeping of a player, without its
// memory.
#pragma once

#include <cstdint>
#include <map>
#include <utility>
#include <vector>

namespace l4d::render {

using BucketKey = std::pair<uint32_t, uint32_t>;  // layer and bucket: in the order of the stream

struct ResidentBucket {
  std::vector<uint32_t> chunks;
  uint32_t slots = 0;
  bool filled = false;
  uint64_t last_required = 0;
};

// A store of chunks of equal size. Buckets that the present turn wants are never given up for
// others; of the rest, those go first that were not wanted for longest, and of these the last in
// the stream.
class ResidentBuckets {
 public:
  explicit ResidentBuckets(uint32_t chunk_slots) : chunk_slots_(chunk_slots) {}

  uint32_t capacity() const { return capacity_; }
  uint32_t used() const { return capacity_ - static_cast<uint32_t>(free_.size()); }
  uint64_t slots() const { return slots_; }  // of all buckets
  uint32_t chunks_of(uint64_t slots) const {
    return static_cast<uint32_t>((slots + chunk_slots_ - 1) / chunk_slots_);
  }

  // Buckets wanted before are not any more.
  void next_turn() { ++turn_; }
  // The bucket, now wanted in this turn; NULL where it is not there.
  ResidentBucket* want(const BucketKey& key);
  const ResidentBucket* find(const BucketKey& key) const;
  // Chunks that buckets nobody wants any more would give.
  uint32_t idle() const;

  // More chunks, up to `capacity`.
  void grow(uint32_t capacity);
  // Room for a bucket that is not there, wanted in this turn; idle ones make place for it. NULL
  // where even that is too little: grow() by what is missing.
  ResidentBucket* add(const BucketKey& key, uint32_t slots);
  void remove(const BucketKey& key);

 private:
  using Buckets = std::map<BucketKey, ResidentBucket>;
  void give_up(Buckets::iterator bucket);

  const uint32_t chunk_slots_;
  uint32_t capacity_ = 0;
  uint64_t slots_ = 0;
  uint64_t turn_ = 1;
  Buckets buckets_;
  std::vector<uint32_t> free_;  // the lowest number last
};

}  // namespace l4d::render
