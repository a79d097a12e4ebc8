// SPDX-License-Identifier: Apache-2.0
#include "render/cuda/player/resident_buckets.h"

#include <algorithm>
#include <functional>

namespace l4d::render {

ResidentBucket* ResidentBuckets::want(const BucketKey& key) {
  const auto found = buckets_.find(key);
  if (found == buckets_.end()) return nullptr;
  found->second.last_required = turn_;
  return &found->second;
}

const ResidentBucket* ResidentBuckets::find(const BucketKey& key) const {
  const auto found = buckets_.find(key);
  return found == buckets_.end() ? nullptr : &found->second;
}

uint32_t ResidentBuckets::idle() const {
  uint32_t chunks = 0;
  for (const auto& [key, bucket] : buckets_) {
    if (bucket.last_required < turn_) chunks += static_cast<uint32_t>(bucket.chunks.size());
  }
  return chunks;
}

void ResidentBuckets::grow(uint32_t capacity) {
  if (capacity <= capacity_) return;
  std::vector<uint32_t> more;
  more.reserve(free_.size() + (capacity - capacity_));
  for (uint32_t chunk = capacity; chunk > capacity_; --chunk) more.push_back(chunk - 1);
  more.insert(more.end(), free_.begin(), free_.end());
  free_ = std::move(more);
  capacity_ = capacity;
}

ResidentBucket* ResidentBuckets::add(const BucketKey& key, uint32_t slots) {
  const uint32_t chunks = chunks_of(slots);
  if (free_.size() + idle() < chunks) return nullptr;
  while (free_.size() < chunks) {
    auto oldest = buckets_.begin();
    for (auto b = buckets_.begin(); b != buckets_.end(); ++b) {
      if (b->second.last_required <= oldest->second.last_required) oldest = b;
    }
    give_up(oldest);
  }
  ResidentBucket bucket;
  bucket.chunks.reserve(chunks);
  for (uint32_t k = 0; k < chunks; ++k) {
    bucket.chunks.push_back(free_.back());
    free_.pop_back();
  }
  bucket.slots = slots;
  bucket.last_required = turn_;
  slots_ += slots;
  return &(buckets_[key] = std::move(bucket));
}

void ResidentBuckets::remove(const BucketKey& key) {
  const auto found = buckets_.find(key);
  if (found != buckets_.end()) give_up(found);
}

void ResidentBuckets::give_up(Buckets::iterator bucket) {
  slots_ -= bucket->second.slots;
  const std::vector<uint32_t>& chunks = bucket->second.chunks;
  free_.insert(free_.end(), chunks.begin(), chunks.end());
  std::sort(free_.begin(), free_.end(), std::greater<uint32_t>());
  buckets_.erase(bucket);
}

}  // namespace l4d::render
