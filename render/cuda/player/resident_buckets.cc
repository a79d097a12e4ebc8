// SPDX-License-Identifier: Apache-2.0
#include "render/cuda/player/resident_buckets.h"

#include <algorithm>
#include <functional>

namespace l4d::render {

ResidentBucket* ResidentBuckets::find(const BucketKey& key) {
  const auto found = buckets_.find(key);
  return found == buckets_.end() ? nullptr : &found->second;
}

void ResidentBuckets::grow(uint32_t capacity) {
  if (capacity <= capacity_) return;
  std::vector<uint32_t> more;
  more.reserve(capacity);  // so that remove() does not have to
  for (uint32_t chunk = capacity; chunk > capacity_; --chunk) more.push_back(chunk - 1);
  more.insert(more.end(), free_.begin(), free_.end());
  free_ = std::move(more);
  capacity_ = capacity;
}

ResidentBucket* ResidentBuckets::add(const BucketKey& key, uint32_t slots) {
  const uint32_t chunks = chunks_of(slots);
  if (free_.size() < chunks) return nullptr;
  ResidentBucket bucket;
  bucket.chunks.assign(free_.rbegin(), free_.rbegin() + chunks);
  bucket.slots = slots;
  ResidentBucket& there = buckets_[key] = std::move(bucket);
  free_.resize(free_.size() - chunks);
  slots_ += slots;
  return &there;
}

void ResidentBuckets::remove(const BucketKey& key) {
  const auto found = buckets_.find(key);
  if (found == buckets_.end()) return;
  const std::vector<uint32_t>& chunks = found->second.chunks;
  free_.insert(free_.end(), chunks.begin(), chunks.end());
  std::sort(free_.begin(), free_.end(), std::greater<uint32_t>());
  slots_ -= found->second.slots;
  buckets_.erase(found);
}

void ResidentBuckets::clear() {
  while (!buckets_.empty()) remove(buckets_.begin()->first);
}

}  // namespace l4d::render
