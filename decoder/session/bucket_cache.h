// SPDX-License-Identifier: Apache-2.0
// Buckets that are ready for slicing, kept so that the next instants need not decode them again.
#pragma once

#include <map>
#include <tuple>
#include <vector>

#include "decoder/session/bucket.h"
#include "decoder/session/open_stream.h"

namespace l4d {

struct CachedBucket {
  PreparedBucket bucket;
  bool with_shape = false;
  Plan missing;  // pages that are lost, or their detail, to be asked for again
  size_t lost_chunks = 0;
  uint64_t memory_bytes = 0;
  uint32_t detail = 0;  // L4D_DETAIL_*
  uint64_t last_use = 0;
  CachedBucket *newer = nullptr, *older = nullptr;  // by last use
  uint64_t number = 0;                              // of all buckets that were ever cached here
};

class BucketCache {
 public:
  explicit BucketCache(OpenStream& stream) : stream_(stream) {}
  BucketCache(const BucketCache&) = delete;
  BucketCache& operator=(const BucketCache&) = delete;

  // Makes every bucket of the plan present, with_shape: with the axes of its Gaussians. *out points
  // to them, one per range, until the next call. Buckets of earlier plans give way where memory
  // does not suffice.
  Status load(const Plan& plan, bool with_shape, std::vector<CachedBucket*>* out);
  // Whether load() would decode nothing for a span, unless it recovers what was lost.
  bool holds(const l4d_bucket_span& span, uint32_t detail, bool with_shape) const;
  // Drops buckets that the last instant did not want, oldest first, until `bytes` fit.
  void make_room(uint64_t bytes) { evict(bytes); }
  bool is_empty() const { return entries_.empty(); }
  void clear();
  // Before the stream is closed: clears the cache and the counters.
  void close();

  uint64_t buckets_decoded() const { return buckets_decoded_; }
  uint64_t hits() const { return hits_; }

 private:
  // Of ranges: RCQ blocks never split a bucket, so layer and bucket name one. Buckets of one detail
  // are of no use to slices of another.
  using Key = std::tuple<uint32_t, uint32_t, uint32_t>;  // layer, bucket, detail
  using Entries = std::map<Key, CachedBucket>;

  static Key key_of(const l4d_bucket_span& span, uint32_t detail);
  // Decodes and prepares one range of a plan, whose tasks are [first_task, end_task), in the form
  // that *out says.
  Status decode(const Plan& plan, size_t span, size_t first_task, size_t end_task,
                CachedBucket* out);
  // Whether pages that a cached bucket lacks can be had now; if not, they are lost again.
  Status has_recovered(const CachedBucket& entry, bool* recovered);
  void drop(Entries::iterator entry);
  // The query at hand wants it.
  void use(CachedBucket* entry);
  void unlink(CachedBucket* entry);
  void evict(uint64_t needed);

  OpenStream& stream_;
  Entries entries_;
  CachedBucket *newest_ = nullptr, *oldest_ = nullptr;  // so that evicting takes no search
  uint64_t bytes_ = 0;
  uint64_t clock_ = 0;
  uint64_t numbered_ = 0;
  uint64_t buckets_decoded_ = 0;
  uint64_t hits_ = 0;
};

}  // namespace l4d
