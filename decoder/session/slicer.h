// SPDX-License-Identifier: Apache-2.0
// The 3D Gaussians of an open stream at an instant, from cached buckets.
#pragma once

#include <vector>

#include "decoder/session/bucket_cache.h"
#include "decoder/session/read_ahead.h"
#include "decoder/session/splat_writer.h"
#include "l4d/experimental/columns.h"

namespace l4d {

class Slicer {
 public:
  explicit Slicer(OpenStream& stream) : stream_(stream), cache_(stream), ahead_(stream, cache_) {}

  Status slice(double time, l4d_splat_buffers* out);
  Status slice(double time, l4d_splat_columns* out);
  // Of the last slice: copies rows of SH of `known` numbers to rows of `width`, whose other numbers
  // are 0. The copies stay until the next call.
  Status widen_rows(size_t known, size_t width, size_t count, const float** rows /* [count] */);
  // Before the stream is closed.
  void close();
  BucketCache& cache() { return cache_; }
  const BucketCache& cache() const { return cache_; }

 private:
  // Sets buckets_ to those of an instant, which is clamped to the sequence.
  Status load_instant(const l4d_operating_point& point, double* time, bool with_shape);
  // Sets still_key_ to what stands for the still rows of an output, new_rows_.
  void set_still();

  OpenStream& stream_;
  BucketCache cache_;
  ReadAhead ahead_;
  // Of the last slice: what the rows are, and the numbers of their buckets.
  std::vector<uint64_t> still_rows_;
  uint64_t still_key_ = 1;
  // Of the slice at hand. They keep their memory: stepping through time allocates none.
  Plan plan_;
  std::vector<CachedBucket*> buckets_;
  std::vector<uint64_t> new_rows_;
  std::vector<Piece> pieces_;
  std::vector<float> wide_sh_;
};

}  // namespace l4d
