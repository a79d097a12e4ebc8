// SPDX-License-Identifier: Apache-2.0
// What both directions of the rANS coder share: tables and blocks (spec: "rANS blocks").
#pragma once

#include <cstdint>

#include "libl4dcodec/base/bytes.h"
#include "libl4dcodec/base/status.h"
#include "libl4dcodec/entropy/rans_kernels.h"

namespace l4d {

constexpr size_t kRansMaxTokens = 256;
constexpr size_t kRansStateBytes = kRansLanes * sizeof(uint32_t);

// frequencies [tokens], tokens <= kRansMaxTokens, with sum kRansSlots; entries [kRansSlots].
void expand_rans_table(const uint32_t* frequencies, size_t tokens, uint32_t* entries);

// Reads one table from `in`, whose first byte lies at file offset `base` (for messages), into
// entries [kRansSlots]. All its tokens are below max_tokens.
Status read_rans_table(ByteReader& in, uint64_t base, size_t max_tokens, uint32_t* entries);

// Starts a block: all of `block`, whose first byte lies at file offset `base`. The kernels then
// take channel after channel from the lanes.
Status open_rans_block(ByteSpan block, uint64_t base, RansLanes* lanes);

// True if all words are used up and every lane is back where the encoder began. That does not
// replace a checksum: a damaged raw bit changes one value and nothing else.
bool rans_block_finished(const RansLanes& lanes);

}  // namespace l4d
