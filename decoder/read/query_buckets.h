// SPDX-License-Identifier: Apache-2.0
// From a query to buckets: what the headers tell, before anything else of the file is read.
#pragma once

#include <vector>

#include "l4d/decode.h"
#include "libl4dcodec/base/status.h"
#include "libl4dcodec/container/scene_header.h"
#include "libl4dcodec/scene/layers.h"

namespace l4d {

// The instants a query asks for, clamped to the sequence.
struct Interval {
  double begin = 0;
  double end = 0;
  bool everything = false;  // whenever it is visible
};

// Buckets of a layer that has Gaussians.
struct BucketRun {
  uint32_t layer = 0;
  BucketRange buckets;
};

struct QueryBuckets {
  Interval interval;
  std::vector<BucketRun> runs;  // in ascending order, those of a layer next to each other
};

// Fails with INVALID_ARGUMENT where the query is none.
Status find_query_buckets(const SceneHeader& header, const l4d_query& query, QueryBuckets* out);

}  // namespace l4d
