// SPDX-License-Identifier: Apache-2.0
// Which bytes of the file a query needs, for those who fetch them themselves.
#pragma once

#include <vector>

#include "decoder/read/scene_file.h"
#include "l4d/decode.h"

namespace l4d {

class Losses;

// The ranges of a query as l4d_decoder_get_reads gives them. step: L4D_READS_*. With `losses`, what
// cannot be read of the directory is told there and left out.
Status find_query_reads(SceneFile& file, const l4d_query& query, uint32_t step, Losses* losses,
                        std::vector<l4d_byte_range>* out);

}  // namespace l4d
