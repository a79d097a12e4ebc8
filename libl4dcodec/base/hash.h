// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "libl4dcodec/base/span.h"

namespace l4d {

// XXH3-64 with seed 0: the checksum of every chunk.
uint64_t hash64(ByteSpan bytes);

}  // namespace l4d
