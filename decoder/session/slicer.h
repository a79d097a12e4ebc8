// SPDX-License-Identifier: Apache-2.0
// The 3D Gaussians of an open stream at an instant, from cached buckets.
#pragma once

#include <vector>

#include "decoder/session/bucket_cache.h"
#include "decoder/session/read_ahead.h"
#include "decoder/session/splat_writer.h"

namespace l4d {

class Slicer {
 public:
  explicit Slicer(OpenStream& stream) : stream_(stream), cache_(stream), ahead_(stream, cache_) {}

  Status slice(double time, l4d_splat_buffers* out);
  Status slice(double time, l4d_splat_columns* out);
  // Kept from stream to stream.
  Status set_detail(uint32_t detail);
  // Layers of finer levels and of higher tiers are left out.
  void set_layers(uint32_t max_level, uint32_t max_tier) {
    max_level_ = max_level;
    max_tier_ = max_tier;
  }
  // Before the stream is closed.
  void close();
  BucketCache& cache() { return cache_; }
  const BucketCache& cache() const { return cache_; }

 private:
  // Sets buckets_ to those of an instant, which is clamped to the sequence.
  Status load_instant(double* time, bool with_shape);
  // Sets still_key_ to what stands for the still rows of an output, new_rows_.
  void set_still();

  OpenStream& stream_;
  BucketCache cache_;
  ReadAhead ahead_;
  uint32_t detail_ = L4D_DETAIL_FULL;
  uint32_t max_level_ = UINT32_MAX;
  uint32_t max_tier_ = UINT32_MAX;
  // Of the last slice: what the rows are, and the numbers of their buckets.
  std::vector<uint64_t> still_rows_;
  uint64_t still_key_ = 1;
  // Of the slice at hand. They keep their memory: stepping through time allocates none.
  Plan plan_;
  std::vector<CachedBucket*> buckets_;
  std::vector<uint64_t> new_rows_;
  std::vector<Piece> pieces_;
};

}  // namespace l4d
