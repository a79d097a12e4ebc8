// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "io/file/file.h"
#include "io/file/memory.h"

namespace l4d::io {

// Reads all of a file, counted by `memory`. Throws Error.
std::vector<uint8_t> read_counted(InputFile* file, const Hold& holder,
                                  std::shared_ptr<void>* memory);

// Expands at most `most` bytes of a gzip file, of bare deflated data, of a zlib stream, or of a
// zstd frame. The result grows with what there is, never with what a header promises. Throws
// Error(L4D_ERR_CORRUPT), whose message begins with `name`.
std::vector<uint8_t> expand_gzip(const uint8_t* data, size_t size, uint64_t most,
                                 const std::string& name);
std::vector<uint8_t> expand_deflate(const uint8_t* data, size_t size, uint64_t most,
                                    const std::string& name);
std::vector<uint8_t> expand_zlib(const uint8_t* data, size_t size, uint64_t most,
                                 const std::string& name);
std::vector<uint8_t> expand_zstd(const uint8_t* data, size_t size, uint64_t most,
                                 const std::string& name);

}  // namespace l4d::io
