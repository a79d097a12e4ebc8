// SPDX-License-Identifier: Apache-2.0
#include <filesystem>
#include <system_error>

#include "io/file/file.h"
#include "io/image/exr_header.h"
#include "io/image/image.h"

namespace l4d::io {
namespace {

bool take(InputFile& file, uint8_t* bytes, size_t n) { return file.read(bytes, n) == n; }

bool pass(InputFile& file, size_t n) {
  uint8_t block[256];
  for (size_t part = 0; n > 0; n -= part) {
    part = n < sizeof block ? n : sizeof block;
    if (!take(file, block, part)) return false;
  }
  return true;
}

// JPEG (ITU-T T.81, B.1.1): segments up to that of the frame, SOF0 to SOF15 but for three codes
// that mean other things; 0xff may stand before a marker any number of times. `file` is behind the
// first marker, SOI.
bool jpeg_size(InputFile& file, uint32_t* size) {
  uint8_t marker[2], bytes[2], frame[5];
  while (take(file, marker, 2) && marker[0] == 0xff) {
    while (marker[1] == 0xff) {
      if (!take(file, &marker[1], 1)) return false;
    }
    const unsigned code = marker[1];
    if (!take(file, bytes, 2)) return false;
    const size_t length = static_cast<size_t>(bytes[0]) << 8 | bytes[1];
    if (length < 2) return false;
    if (code >= 0xc0 && code <= 0xcf && code != 0xc4 && code != 0xc8 && code != 0xcc) {
      if (length < 2 + sizeof frame || !take(file, frame, sizeof frame)) return false;
      size[0] = static_cast<uint32_t>(frame[3]) << 8 | frame[4];
      size[1] = static_cast<uint32_t>(frame[1]) << 8 | frame[2];
      return size[0] > 0 && size[1] > 0;
    }
    if (!pass(file, length - 2)) return false;
  }
  return false;
}

}  // namespace

bool image_size(const std::string& path, uint32_t* size) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) return false;
  InputFile file(path);
  uint8_t begin[kPngSizeBytes];
  if (!take(file, begin, 2)) return false;
  if (begin[0] == 0xff && begin[1] == 0xd8) return jpeg_size(file, size);
  if (!take(file, begin + 2, sizeof begin - 2)) return false;
  if (!is_exr(begin, sizeof begin)) return png_size(begin, size);
  const ExrHeader header = read_exr_header(&file);
  size[0] = header.width;
  size[1] = header.height;
  return true;
}

}  // namespace l4d::io
