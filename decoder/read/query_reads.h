// SPDX-License-Identifier: Apache-2.0
// Which bytes of the file a query needs, for callers that fetch them themselves.
#pragma once

#include <vector>

#include "decoder/read/plan.h"
#include "decoder/read/query_buckets.h"
#include "decoder/read/scene_file.h"
#include "l4d/decode.h"

namespace l4d {

class Losses;

// The ranges of a query as l4d_decoder_get_reads gives them. step: L4D_READS_*. With `losses`, what
// cannot be read of the directory is listed there and left out.
Status find_query_reads(SceneFile& file, const l4d_query& query, uint32_t step, Losses* losses,
                        std::vector<l4d_byte_range>* out);

// Of all layers: codebooks and entropy tables, and the page tables where they are not too large to
// be read with them.
Status find_table_reads(SceneFile& file, uint64_t max_page_table_bytes,
                        std::vector<l4d_byte_range>* out);
// The directory of some buckets. Page tables are read for it.
Status find_directory_reads(SceneFile& file, const QueryBuckets& buckets,
                            std::vector<l4d_byte_range>* out);
// The codebooks and entropy tables of a plan.
Status find_plan_table_reads(SceneFile& file, const Plan& plan, std::vector<l4d_byte_range>* out);
// The pages of its wanted spans, chunk by chunk.
Status find_chunk_reads(SceneFile& file, const Plan& plan, const std::vector<bool>& wanted,
                        std::vector<l4d_byte_range>* out);

}  // namespace l4d
