// SPDX-License-Identifier: Apache-2.0
// The 3D Gaussians of an open stream at an instant, from cached buckets.
#pragma once

#include <vector>

#include "decoder/session/bucket_cache.h"

namespace l4d {

class Slicer {
 public:
  explicit Slicer(OpenStream& stream) : stream_(stream), cache_(stream) {}

  Status slice(double time, l4d_splat_buffers* out);
  Status slice(double time, l4d_splat_columns* out);
  // Kept from stream to stream.
  Status set_detail(uint32_t detail);
  // Before the stream is closed.
  void close() { cache_.close(); }
  const BucketCache& cache() const { return cache_; }

 private:
  // The buckets of an instant, which is clamped to the sequence.
  Status load_instant(double* time, bool with_shape, std::vector<CachedBucket*>* buckets);
  // Sets still_key_ to what stands for the still rows of an output: their kind, and the numbers of
  // their buckets.
  void set_still(std::vector<uint64_t> rows);

  OpenStream& stream_;
  BucketCache cache_;
  uint32_t detail_ = L4D_DETAIL_FULL;
  std::vector<uint64_t> still_rows_;  // of the last slice
  uint64_t still_key_ = 1;
};

}  // namespace l4d
