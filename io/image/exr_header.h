// SPDX-License-Identifier: Apache-2.0
// What an OpenEXR file says before its pixels ("OpenEXR File Layout"), read by this code and not by
// the program that decodes them: sizes are known before anything is allocated, and what that
// program would take for something else is refused.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "io/file/file.h"

namespace l4d::io {

struct ExrHeader {
  uint32_t width = 0, height = 0;
  bool has_alpha = false;
  bool is_compressed = false;
  uint32_t pixel_bytes = 0;   // of all channels, unpacked
  uint32_t block_width = 0;   // pixels of a tile, or of a row
  uint32_t block_height = 0;  // of a tile, or of the rows that are packed together
  bool is_tiled = false;
  uint64_t end = 0;  // where the table of blocks begins

  uint64_t block_bytes() const {  // of the largest, unpacked
    return uint64_t{std::min(block_width, width)} * std::min(block_height, height) * pixel_bytes;
  }
};

constexpr size_t kExrMagicBytes = 4;
bool is_exr(const uint8_t* begin, size_t n);

// Throws L4D_ERR_FEATURE_UNSUPPORTED, with what it is, for what has other pixels than one picture
// of R, G, B and perhaps A, of floats, from the corner on; L4D_ERR_CORRUPT for no EXR.
ExrHeader read_exr_header(InputFile* file);
}  // namespace l4d::io
