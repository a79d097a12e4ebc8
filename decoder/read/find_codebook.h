// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "decoder/read/scene_file.h"
#include "l4d/decode.h"
#include "l4d/experimental/packed.h"

namespace l4d {

// As l4d_decoder_get_codebook. block: as in l4d_bucket_span. Entries live as CodebookCache says.
Status find_codebook(SceneFile& file, uint32_t layer, uint32_t component, uint32_t stage,
                     uint32_t block, l4d_codebook* out);

}  // namespace l4d
