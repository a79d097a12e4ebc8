// SPDX-License-Identifier: Apache-2.0
// Files of a few kB that have every coding tool between them: the seeds of all damage.
#pragma once

#include <string>
#include <vector>

#include "libl4dcodec/base/bytes.h"

namespace l4d::test {

struct SmallFile {
  std::string name;
  Bytes bytes;
};

// plain (motion, permanent layer), stages (residual stages, escapes), degree3 (SH), blocks (RCQ),
// lossless, packed (every chunk under zstd), transform, rans and rans-transform (rANS pages), parts
// and parts-base (these with SH detail apart). Made once per process; throws where that fails.
const std::vector<SmallFile>& small_files();

}  // namespace l4d::test
