// SPDX-License-Identifier: Apache-2.0
#include "io/formats/fdgs_streams.h"

#include <zlib.h>

#include <algorithm>
#include <cstring>
#include <limits>

#include "io/file/little_endian.h"
#include "io/formats/inflate.h"

namespace l4d::io::fdgs {
namespace {

using Bytes = std::vector<uint8_t>;

enum Mode : uint8_t { kRaw = 0, kDelta = 1, kConstant = 2 };
enum Codec : uint8_t { kDeflate = 0, kZstd = 1 };

int32_t signed_of(uint32_t zigzag) {
  return static_cast<int32_t>((zigzag >> 1) ^ (0U - (zigzag & 1)));
}
uint32_t zigzag_of(int64_t value) {
  return static_cast<uint32_t>((static_cast<uint64_t>(value) << 1) ^
                               static_cast<uint64_t>(value >> 63));
}
bool fits(int64_t value) {
  return value >= std::numeric_limits<int32_t>::min() &&
         value <= std::numeric_limits<int32_t>::max();
}

// Sums of each channel along the rows.
void add_up(size_t channels, std::vector<int32_t>* values, const std::string& name) {
  for (size_t i = channels; i < values->size(); ++i) {
    const int64_t sum = int64_t{(*values)[i]} + (*values)[i - channels];
    if (!fits(sum)) throw Error(L4D_ERR_CORRUPT, name + ": an integer exceeds 32 bits");
    (*values)[i] = static_cast<int32_t>(sum);
  }
}

// False where a difference exceeds 32 bits.
bool differences(size_t channels, const std::vector<int32_t>& values, std::vector<int32_t>* out) {
  *out = values;
  for (size_t i = channels; i < values.size(); ++i) {
    const int64_t difference = int64_t{values[i]} - values[i - channels];
    if (!fits(difference)) return false;
    (*out)[i] = static_cast<int32_t>(difference);
  }
  return true;
}

struct Payload {
  uint8_t width = 1;
  Bytes bytes;
};

// Byte planes, the lowest first, deflated.
Payload payload_of(const std::vector<int32_t>& values) {
  constexpr int kLevel = 6;
  uint32_t most = 0;
  for (const int32_t v : values) most = std::max(most, zigzag_of(v));
  Payload out;
  out.width = most < 256 ? 1 : most < 65536 ? 2 : 4;
  Bytes planes;
  planes.reserve(values.size() * out.width);
  for (unsigned j = 0; j < out.width; ++j) {
    for (const int32_t v : values) {
      planes.push_back(static_cast<uint8_t>(zigzag_of(v) >> (8 * j)));
    }
  }
  uLongf size = compressBound(static_cast<uLong>(planes.size()));
  out.bytes.resize(size);
  if (compress2(out.bytes.data(), &size, planes.data(), static_cast<uLong>(planes.size()),
                kLevel) != Z_OK) {
    throw Error(L4D_ERR_OUT_OF_MEMORY, "not enough memory to compress a stream");
  }
  out.bytes.resize(size);
  return out;
}

bool all_rows_equal(size_t channels, const std::vector<int32_t>& values) {
  return values.size() > channels && std::equal(values.begin() + static_cast<ptrdiff_t>(channels),
                                                values.end(), values.begin());
}

}  // namespace

void Fields::fail(const std::string& message) const {
  throw Error(L4D_ERR_CORRUPT, name_ + ": " + message);
}

const uint8_t* Fields::bytes(uint64_t size) {
  if (size > left_) fail("it ends early");
  const uint8_t* at = at_;
  at_ += size;
  left_ -= size;
  return at;
}

uint32_t Fields::u32() { return little_endian32(bytes(4)); }
uint64_t Fields::u64() { return little_endian64(bytes(8)); }
double Fields::f64() {
  const uint64_t bits = u64();
  double value = 0;
  std::memcpy(&value, &bits, sizeof(value));
  return value;
}

std::string Fields::text() {
  const uint32_t size = u32();
  const uint8_t* at = bytes(size);
  return {at, at + size};
}

Texts Fields::texts() {
  const uint32_t size = u32();
  Fields block(bytes(size), size, name_);
  Texts out;
  while (block.left() > 0) {
    std::string key = block.text();
    out[std::move(key)] = block.text();
  }
  return out;
}

PackedStream next_stream(Fields* fields) {
  PackedStream s;
  s.attribute = fields->u8();
  s.width = fields->u8();
  s.mode = fields->u8();
  s.codec = fields->u8();
  s.channels = fields->u8();
  s.count = fields->u32();
  s.bytes = fields->u64();
  s.payload = fields->bytes(s.bytes);
  return s;
}

Bins expand_stream(const PackedStream& s, const std::string& name) {
  const auto fail = [&](const std::string& message) {
    throw Error(L4D_ERR_CORRUPT,
                name + ": attribute " + std::to_string(s.attribute) + ": " + message);
  };
  if (s.codec > kZstd) {
    throw Error(L4D_ERR_FEATURE_UNSUPPORTED, name + ": codec " + std::to_string(s.codec) +
                                                 " of .4dgs; 0 (deflate) and 1 (zstd) are read");
  }
  if ((s.width != 1 && s.width != 2 && s.width != 4) || s.mode > kConstant || s.channels == 0) {
    fail("its symbols are of no known form");
  }
  Bins out;
  out.channels = s.channels;
  out.is_constant = s.mode == kConstant;
  const uint64_t symbols = uint64_t{out.is_constant ? 1 : s.count} * s.channels;
  if (s.count == 0) return out;
  const uint64_t size = symbols * s.width;
  // One byte more shows that there is too much, and that the end and its checksum are right.
  const Bytes raw = s.codec == kZstd
                        ? expand_zstd(s.payload, static_cast<size_t>(s.bytes), size + 1, name)
                        : expand_zlib(s.payload, static_cast<size_t>(s.bytes), size + 1, name);
  if (raw.size() != size) fail("it has another length than its elements need");
  const size_t n = static_cast<size_t>(symbols);
  out.values.resize(n);
  for (size_t i = 0; i < n; ++i) {
    uint32_t u = 0;
    for (unsigned j = 0; j < s.width; ++j) u |= uint32_t{raw[j * n + i]} << (8 * j);
    out.values[i] = signed_of(u);
  }
  if (s.mode == kDelta) add_up(s.channels, &out.values, name);
  return out;
}

Bytes pack_stream(uint8_t attribute, uint8_t channels, const std::vector<int32_t>& values) {
  const size_t count = values.size() / channels;
  Mode mode = kRaw;
  Payload best;
  if (all_rows_equal(channels, values)) {
    mode = kConstant;
    best = payload_of({values.begin(), values.begin() + channels});
  } else {
    best = payload_of(values);
    std::vector<int32_t> steps;
    if (differences(channels, values, &steps)) {
      Payload delta = payload_of(steps);
      if (delta.bytes.size() < best.bytes.size()) {
        mode = kDelta;
        best = std::move(delta);
      }
    }
  }
  Bytes out = {attribute, best.width, mode, kDeflate, channels};
  append_little_endian(&out, count, 4);
  append_little_endian(&out, best.bytes.size(), 8);
  out.insert(out.end(), best.bytes.begin(), best.bytes.end());
  return out;
}

}  // namespace l4d::io::fdgs
