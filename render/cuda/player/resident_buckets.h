// SPDX-License-Identifier: Apache-2.0
// Which time buckets lie in which chunks of a store: the bookkeeping of a player, without its
// memory.
#pragma once

#include <cstdint>
#include <map>
#include <tuple>
#include <vector>

namespace l4d::render {

// In the order in which frames show them.
struct BucketKey {
  uint32_t stream, layer, bucket;
  bool operator<(const BucketKey& b) const {
    return std::tie(stream, layer, bucket) < std::tie(b.stream, b.layer, b.bucket);
  }
};

struct ResidentBucket {
  std::vector<uint32_t> chunks;
  uint32_t slots = 0;
  double begin = 0, end = 0;  // when some of it may be visible, seconds
  uint32_t group = 0;         // its caller's
  bool filled = false;
};

// A store of chunks of equal size.
class ResidentBuckets {
 public:
  using Buckets = std::map<BucketKey, ResidentBucket>;
  explicit ResidentBuckets(uint32_t chunk_slots) : chunk_slots_(chunk_slots) {}

  uint32_t chunk_slots() const { return chunk_slots_; }
  uint32_t capacity() const { return capacity_; }
  uint32_t used() const { return capacity_ - static_cast<uint32_t>(free_.size()); }
  uint64_t slots() const { return slots_; }  // of all buckets
  uint32_t chunks_of(uint64_t slots) const {
    return static_cast<uint32_t>((slots + chunk_slots_ - 1) / chunk_slots_);
  }
  const Buckets& all() const { return buckets_; }
  // NULL where the bucket is not there.
  ResidentBucket* find(const BucketKey& key);

  // More chunks, up to `capacity`.
  void grow(uint32_t capacity);
  // Room for a bucket that is not there, in the lowest chunks that are free. NULL where they are
  // too few: grow() by what is missing.
  ResidentBucket* add(const BucketKey& key, uint32_t slots);
  void remove(const BucketKey& key);
  void clear();

 private:
  const uint32_t chunk_slots_;
  uint32_t capacity_ = 0;
  uint64_t slots_ = 0;
  Buckets buckets_;
  std::vector<uint32_t> free_;  // the lowest number last
};

}  // namespace l4d::render
