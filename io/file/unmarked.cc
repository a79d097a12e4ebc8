// SPDX-License-Identifier: Apache-2.0
#include "io/file/unmarked.h"

#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "io/file/little_endian.h"

namespace l4d::io {
namespace {

bool is_zero(char c) { return c == 0; }

bool is_splat_record(const uint8_t* record) {
  constexpr float kFarthest = 1e8F, kLargest = 1e6F;
  for (size_t k = 0; k < 3; ++k) {
    const float x = little_endian_float(record + 4 * k);
    const float scale = little_endian_float(record + 12 + 4 * k);
    // Comparisons with what is no number are false.
    if (!(std::abs(x) < kFarthest && scale >= 0 && scale < kLargest)) return false;
  }
  double sum = 0;
  for (size_t k = 28; k < 32; ++k) sum += (record[k] - 128.0) * (record[k] - 128.0) / (128 * 128);
  return sum > 0.9 && sum < 1.1;
}

}  // namespace

bool looks_like_splat(std::string_view head, uint64_t size) {
  constexpr size_t kRecord = 32;
  if (size % kRecord != 0) return false;
  size_t found = 0;
  for (; head.size() >= kRecord; head.remove_prefix(kRecord)) {
    const std::string_view record = head.substr(0, kRecord);
    if (std::all_of(record.begin(), record.end(), is_zero)) continue;  // of padding
    if (!is_splat_record(reinterpret_cast<const uint8_t*>(record.data()))) return false;
    ++found;
  }
  return found > 0;
}

bool looks_like_ksplat(std::string_view head, uint64_t size) {
  constexpr size_t kFields = 48, kHeader = 4096, kSection = 1024;
  constexpr uint32_t kMostLevel = 2;
  if (head.size() <= kFields || size < kHeader) return false;
  const auto* bytes = reinterpret_cast<const uint8_t*>(head.data());
  const uint64_t sections = little_endian32(bytes + 4);
  return bytes[0] == 0 && bytes[1] > 0 && little_endian16(bytes + 20) <= kMostLevel &&
         sections > 0 && sections <= (size - kHeader) / kSection &&
         std::all_of(head.begin() + kFields, head.begin() + std::min(head.size(), kHeader),
                     is_zero);
}

bool is_gzip_of(std::string_view head, std::string_view magic) {
  z_stream stream{};
  if (inflateInit2(&stream, 15 + 16) != Z_OK) return false;
  std::string out(magic.size(), '\0');
  stream.next_in =
      const_cast<Bytef*>(reinterpret_cast<const Bytef*>(head.data()));  // NOLINT: it is only read
  stream.avail_in = static_cast<uInt>(head.size());
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  inflate(&stream, Z_SYNC_FLUSH);
  const bool is_whole = stream.avail_out == 0;
  inflateEnd(&stream);
  return is_whole && out == magic;
}

}  // namespace l4d::io
