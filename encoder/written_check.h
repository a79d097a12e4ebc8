// SPDX-License-Identifier: Apache-2.0
// The last look at a stream before anyone gets a byte of it.
#pragma once

#include <vector>

#include "libl4dcodec/base/bytes.h"
#include "libl4dcodec/base/status.h"

namespace l4d {

// Reads headers, codebooks, entropy tables and the whole directory of the stream that `chunks` make
// up, as a decoder does. Fails with INTERNAL, and the rule that is broken, where a decoder would
// refuse them: an encoder must not write what no decoder takes (ENC-1).
Status check_written(const std::vector<Bytes>& chunks);

}  // namespace l4d
