// SPDX-License-Identifier: Apache-2.0
// Queries of an open stream: what they select, and what they decode to.
#pragma once

#include "decoder/session/open_stream.h"
#include "l4d/experimental/packed.h"

namespace l4d {

Status select_query(OpenStream& stream, const l4d_query& query, l4d_selection* out);
Status find_ranges(OpenStream& stream, const l4d_query& query, l4d_bucket_span* out,
                   uint64_t capacity, uint64_t* count);
// *num_buckets: how many were decoded.
Status decode_query(OpenStream& stream, const l4d_query& query, l4d_gaussian_buffers* out,
                    uint64_t* num_buckets);
Status decode_query_packed(OpenStream& stream, const l4d_query& query, l4d_packed_buffers* out,
                           uint64_t* num_buckets);

}  // namespace l4d
