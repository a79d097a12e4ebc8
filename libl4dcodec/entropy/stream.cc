// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/entropy/stream.h"

#include <algorithm>
#include <cstring>

namespace l4d {
namespace {

// A byte plane is compressed if that saves one part in this many. Below it the bytes saved are not
// worth the time: a stored plane is read in place.
constexpr size_t kMinPlaneSaving = 10;

struct StreamHead {
  StreamLayout layout = StreamLayout::kPacked;
  bool delta = false;
};

Status parse_mode(ByteReader& in, uint64_t base, unsigned width, StreamHead* head) {
  const uint64_t at = base + in.position();
  const uint8_t mode = in.le<uint8_t>();
  if (in.failed()) return corrupt("STRM-2", at, "stream head past the end of its chunk");
  const unsigned layout = mode & kStreamLayoutMask;
  if ((mode & ~(kStreamLayoutMask | kStreamDeltaBit)) != 0 || layout > 2) {
    return corrupt("STRM-1", at, "unknown stream mode " + std::to_string(mode));
  }
  head->layout = static_cast<StreamLayout>(layout);
  head->delta = (mode & kStreamDeltaBit) != 0;
  if (head->delta && ((width != 16 && width != 32) || head->layout == StreamLayout::kConstant)) {
    return corrupt("STRM-6", at, "delta on a stream of " + std::to_string(width) + " bits");
  }
  return {};
}

// Reads `count` byte planes of n bytes; plane p begins at planes[p], in `in` itself or in scratch.
Status read_planes(StreamDecoder& decoder, ByteReader& in, uint64_t base, size_t n, unsigned count,
                   const unsigned char** planes) {
  if (decoder.planes.size() < n * count) decoder.planes.resize(n * count);
  for (unsigned p = 0; p < count; ++p) {
    const uint64_t at = base + in.position();
    const uint8_t codec = in.le<uint8_t>();
    if (codec == static_cast<uint8_t>(ChunkCodec::kStored)) {
      planes[p] = in.take(n).data();
      if (in.failed()) return corrupt("STRM-2", at, "byte plane past the end of its chunk");
    } else if (codec == static_cast<uint8_t>(ChunkCodec::kZstd)) {
      const ByteSpan frame = in.take(in.vlq());
      if (in.failed()) return corrupt("STRM-2", at, "byte plane past the end of its chunk");
      unsigned char* dst = decoder.planes.data() + p * n;
      if (!decoder.zstd.decompress(frame, dst, n)) {
        return corrupt("CHNK-5", at,
                       "zstd frame does not decode to " + std::to_string(n) + " bytes");
      }
      planes[p] = dst;
    } else {
      return Status(L4D_ERR_FEATURE_UNSUPPORTED, "CHNK-6", at,
                    "unknown codec " + std::to_string(codec));
    }
  }
  return {};
}

Status read_constant(ByteReader& in, uint64_t base, unsigned width, uint32_t* value) {
  const uint64_t at = base + in.position();
  const ByteSpan bytes = in.take((width + 7) / 8);
  if (in.failed()) return corrupt("STRM-2", at, "constant past the end of its chunk");
  *value = 0;
  for (size_t i = 0; i < bytes.size(); ++i) *value |= uint32_t{bytes[i]} << (8 * i);
  return {};
}

}  // namespace

unsigned bit_width(uint32_t limit) {
  unsigned bits = 0;
  while (bits < 32 && (uint64_t{1} << bits) < limit) ++bits;
  return bits;
}

Status decode_stream(StreamDecoder& decoder, ByteReader& in, uint64_t base, size_t n,
                     unsigned width, uint32_t limit, const char* limit_clause, uint16_t* dst) {
  if (n == 0) return {};
  if (width == 0) {
    std::fill(dst, dst + n, uint16_t{0});
    return {};
  }
  const uint64_t at = base + in.position();
  StreamHead head;
  L4D_RETURN_IF_ERROR(parse_mode(in, base, width, &head));
  const StreamKernels& kernels = *decoder.kernels;
  switch (head.layout) {
    case StreamLayout::kPacked: {
      const uint64_t bits = uint64_t{n} * width;
      const ByteSpan bytes = in.take((bits + 7) / 8);
      if (in.failed()) return corrupt("STRM-2", at, "packed stream past the end of its chunk");
      if (bits % 8 != 0 && (bytes[bytes.size() - 1] >> (bits % 8)) != 0) {
        return corrupt("STRM-4", at, "padding bits are not zero");
      }
      kernels.unpack_bits(bytes.data(), bytes.size(), n, width, dst);
      break;
    }
    case StreamLayout::kPlanes: {
      const unsigned char* planes[2];
      L4D_RETURN_IF_ERROR(read_planes(decoder, in, base, n, (width + 7) / 8, planes));
      if (width > 8) {
        kernels.merge_bytes(planes[0], planes[1], n, dst);
      } else {
        kernels.widen_bytes(planes[0], n, dst);
      }
      break;
    }
    case StreamLayout::kConstant: {
      uint32_t value = 0;
      L4D_RETURN_IF_ERROR(read_constant(in, base, width, &value));
      std::fill(dst, dst + n, static_cast<uint16_t>(value));
      break;
    }
  }
  if (head.delta) kernels.undelta(dst, n);
  if (limit == 0 && width == 16) return {};
  const uint32_t bound = limit != 0 ? limit : 1u << width;
  const uint32_t largest = kernels.max_value(dst, n);
  if (largest >= bound) {
    return corrupt(limit != 0 ? limit_clause : "STRM-3", at,
                   "value " + std::to_string(largest) + " is not below " + std::to_string(bound));
  }
  return {};
}

Status decode_stream32(StreamDecoder& decoder, ByteReader& in, uint64_t base, size_t n,
                       uint32_t* dst) {
  if (n == 0) return {};
  const uint64_t at = base + in.position();
  StreamHead head;
  L4D_RETURN_IF_ERROR(parse_mode(in, base, 32, &head));
  switch (head.layout) {
    case StreamLayout::kPacked: {
      const ByteSpan bytes = in.take(uint64_t{n} * 4);
      if (in.failed()) return corrupt("STRM-2", at, "packed stream past the end of its chunk");
      for (size_t i = 0; i < n; ++i) dst[i] = load_le<uint32_t>(bytes.data() + 4 * i);
      break;
    }
    case StreamLayout::kPlanes: {
      const unsigned char* planes[4];
      L4D_RETURN_IF_ERROR(read_planes(decoder, in, base, n, 4, planes));
      for (size_t i = 0; i < n; ++i) {
        dst[i] = uint32_t{planes[0][i]} | uint32_t{planes[1][i]} << 8 |
                 uint32_t{planes[2][i]} << 16 | uint32_t{planes[3][i]} << 24;
      }
      break;
    }
    case StreamLayout::kConstant: {
      uint32_t value = 0;
      L4D_RETURN_IF_ERROR(read_constant(in, base, 32, &value));
      std::fill(dst, dst + n, value);
      break;
    }
  }
  if (head.delta) {
    uint32_t previous = 0;
    for (size_t i = 0; i < n; ++i) {
      previous += (dst[i] >> 1) ^ (0u - (dst[i] & 1u));
      dst[i] = previous;
    }
  }
  return {};
}

Status skip_stream(ByteReader& in, uint64_t base, size_t n, unsigned width) {
  if (n == 0 || width == 0) return {};
  const uint64_t at = base + in.position();
  StreamHead head;
  L4D_RETURN_IF_ERROR(parse_mode(in, base, width, &head));
  const unsigned bytes = (width + 7) / 8;
  switch (head.layout) {
    case StreamLayout::kPacked:
      in.take((uint64_t{n} * width + 7) / 8);
      break;
    case StreamLayout::kPlanes:
      for (unsigned p = 0; p < bytes; ++p) {
        const uint8_t codec = in.le<uint8_t>();
        if (codec > static_cast<uint8_t>(ChunkCodec::kZstd)) {
          return Status(L4D_ERR_FEATURE_UNSUPPORTED, "CHNK-6", at,
                        "unknown codec " + std::to_string(codec));
        }
        in.take(codec == static_cast<uint8_t>(ChunkCodec::kStored) ? n : in.vlq());
      }
      break;
    case StreamLayout::kConstant:
      in.take(bytes);
      break;
  }
  if (in.failed()) return corrupt("STRM-2", at, "stream past the end of its chunk");
  return {};
}

template <typename T>
Bytes StreamEncoder::encode_form(const T* values, size_t n, unsigned width, bool delta) {
  std::vector<T> coded(values, values + n);
  if (delta) {
    T previous = 0;
    for (T& v : coded) {
      const uint32_t d = static_cast<T>(uint32_t{v} - uint32_t{previous});
      previous = v;
      const uint32_t sign = 0u - (d >> (8 * sizeof(T) - 1));
      v = static_cast<T>((d << 1) ^ sign);
    }
  }
  const uint8_t delta_bit = delta ? kStreamDeltaBit : uint8_t{0};
  Bytes planes_form{static_cast<uint8_t>(static_cast<uint8_t>(StreamLayout::kPlanes) | delta_bit)};
  Bytes plane(n);
  for (unsigned p = 0; p < (width + 7) / 8; ++p) {
    for (size_t i = 0; i < n; ++i) plane[i] = static_cast<unsigned char>(coded[i] >> (8 * p));
    const Bytes frame = zstd_.compress(plane);
    if (frame.size() + n / kMinPlaneSaving < n) {
      planes_form.push_back(static_cast<uint8_t>(ChunkCodec::kZstd));
      append_vlq(frame.size(), planes_form);
      planes_form.insert(planes_form.end(), frame.begin(), frame.end());
    } else {
      planes_form.push_back(static_cast<uint8_t>(ChunkCodec::kStored));
      planes_form.insert(planes_form.end(), plane.begin(), plane.end());
    }
  }
  const size_t packed_bytes = 1 + (n * width + 7) / 8;
  if (delta || planes_form.size() + packed_bytes / 50 < packed_bytes) return planes_form;
  Bytes packed(packed_bytes, 0);
  packed[0] = static_cast<uint8_t>(StreamLayout::kPacked);
  for (size_t i = 0; i < n; ++i) {
    for (unsigned b = 0; b < width; ++b) {
      const size_t bit = i * width + b;
      unsigned char& byte = packed[1 + bit / 8];
      byte = static_cast<unsigned char>(byte | (((uint32_t{coded[i]} >> b) & 1u) << (bit % 8)));
    }
  }
  return packed;
}

template <typename T>
void StreamEncoder::encode_any(const T* values, size_t n, unsigned width, bool try_delta,
                               Bytes& out) {
  if (n == 0 || width == 0) return;
  if (std::all_of(values, values + n, [&](T v) { return v == values[0]; })) {
    out.push_back(static_cast<uint8_t>(StreamLayout::kConstant));
    for (unsigned p = 0; p < (width + 7) / 8; ++p) {
      out.push_back(static_cast<unsigned char>(values[0] >> (8 * p)));
    }
    return;
  }
  Bytes best = encode_form(values, n, width, false);
  if (try_delta) {
    Bytes delta = encode_form(values, n, width, true);
    if (delta.size() < best.size()) best = std::move(delta);
  }
  out.insert(out.end(), best.begin(), best.end());
}

void StreamEncoder::encode(const uint16_t* values, size_t n, unsigned width, bool try_delta,
                           Bytes& out) {
  encode_any(values, n, width, try_delta && width == 16, out);
}

void StreamEncoder::encode32(const uint32_t* values, size_t n, bool try_delta, Bytes& out) {
  encode_any(values, n, 32, try_delta, out);
}

Status decode_chunk(StreamDecoder& decoder, uint32_t codec, ByteSpan stored, uint64_t raw_bytes,
                    uint64_t max_raw_bytes, uint64_t offset, Bytes& storage, ByteSpan* out) {
  if (raw_bytes > max_raw_bytes) {
    return corrupt("CHNK-8", offset,
                   "chunk of " + std::to_string(raw_bytes) + " bytes, its content takes at most " +
                       std::to_string(max_raw_bytes));
  }
  if (codec == static_cast<uint32_t>(ChunkCodec::kStored)) {
    if (stored.size() != raw_bytes) {
      return corrupt("CHNK-3", offset, "stored chunk whose sizes differ");
    }
    *out = stored;
    return {};
  }
  if (codec != static_cast<uint32_t>(ChunkCodec::kZstd)) {
    return Status(L4D_ERR_FEATURE_UNSUPPORTED, "CHNK-6", offset,
                  "unknown codec " + std::to_string(codec));
  }
  storage.resize(static_cast<size_t>(raw_bytes));
  if (!decoder.zstd.decompress(stored, storage.data(), storage.size())) {
    return corrupt("CHNK-5", offset,
                   "zstd frame does not decode to " + std::to_string(raw_bytes) + " bytes");
  }
  *out = ByteSpan(storage.data(), storage.size());
  return {};
}

}  // namespace l4d
