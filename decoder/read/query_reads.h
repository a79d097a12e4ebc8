// SPDX-License-Identifier: Apache-2.0
// Which bytes of the file a query needs, to be read before they are wanted.
#pragma once

#include <vector>

#include "decoder/read/plan.h"
#include "decoder/read/query_buckets.h"
#include "decoder/read/scene_file.h"
#include "l4d/decode.h"

namespace l4d {

// Of all layers: codebooks and entropy tables, and the page tables where they are not too large to
// be read with them.
Status find_table_reads(SceneFile& file, uint64_t max_page_table_bytes,
                        std::vector<ByteRange>* out);
// The entries of page tables of some buckets.
Status find_page_table_reads(SceneFile& file, const QueryBuckets& buckets,
                             std::vector<ByteRange>* out);
// Their directory. Page tables are read for it, and what cannot be read of it is left out.
Status find_directory_reads(SceneFile& file, const QueryBuckets& buckets,
                            std::vector<ByteRange>* out);
// The codebooks and entropy tables of a plan.
Status find_plan_table_reads(SceneFile& file, const Plan& plan, std::vector<ByteRange>* out);
// The pages of its wanted spans, chunk by chunk.
Status find_chunk_reads(SceneFile& file, const Plan& plan, const std::vector<bool>& wanted,
                        std::vector<ByteRange>* out);

}  // namespace l4d
