// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/base/hash.h"

#include <xxhash.h>

namespace l4d {

uint64_t hash64(ByteSpan bytes) { return XXH3_64bits(bytes.data(), bytes.size()); }

}  // namespace l4d
