// SPDX-License-Identifier: Apache-2.0
// What slices will need, read before they do.
#pragma once

#include <vector>

#include "decoder/read/plan.h"
#include "decoder/session/bucket_cache.h"
#include "decoder/session/open_stream.h"

namespace l4d {

// Reads all that an instant lacks at once, and what the next second will lack with it while slices
// step forward.
class ReadAhead {
 public:
  ReadAhead(OpenStream& stream, const BucketCache& cache) : stream_(stream), cache_(cache) {}

  // Before the plan of an instant, a TIME query.
  void fetch_directory(const l4d_query& instant);
  // After it, before its buckets are loaded.
  void fetch_buckets(const l4d_query& instant, const Plan& plan, bool with_shape);
  void close();

 private:
  // The instant, or the second from it on.
  l4d_query window(const l4d_query& instant) const;
  // Sets wanted_. Returns whether some span of the plan is not in the cache.
  bool find_wanted(const Plan& plan, bool with_shape);

  OpenStream& stream_;
  const BucketCache& cache_;
  double time_ = 0;  // of the last instant
  bool has_time_ = false;
  bool playing_ = false;
  std::vector<bool> wanted_;
};

}  // namespace l4d
