// SPDX-License-Identifier: Apache-2.0
// Which bytes of a stream that is supplied piece by piece its slices lack.
#pragma once

#include <vector>

#include "decoder/session/bucket_cache.h"
#include "decoder/session/open_stream.h"
#include "l4d/stream.h"

namespace l4d {

// query: resolved, no zeros but max_bytes and merge_gap.
Status plan_supplies(OpenStream& stream, const BucketCache& cache, const l4d_plan_query& query,
                     std::vector<l4d_planned_range>* out);
Status find_buffered(OpenStream& stream, const BucketCache& cache, const l4d_plan_query& query,
                     std::vector<l4d_time_span>* out);

}  // namespace l4d
