// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cstring>

#include "libl4dcodec/base/ordered.h"
#include "libl4dcodec/entropy/stream_kernels.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "libl4dcodec/entropy/stream_kernels_simd.cc"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace l4d {
namespace HWY_NAMESPACE {
namespace {
namespace hn = hwy::HWY_NAMESPACE;

void unpack_bits(const unsigned char* src, size_t src_bytes, size_t n, unsigned width,
                 uint16_t* dst) {
  const unsigned mask = (1u << width) - 1u;
  size_t i = 0;
#if HWY_TARGET != HWY_SCALAR
  // A value of up to 16 bits at any bit position lies within 4 bytes of its first byte.
  const hn::ScalableTag<uint32_t> d32;
  const hn::Rebind<int32_t, decltype(d32)> di32;
  const hn::Rebind<uint16_t, decltype(d32)> d16;
  const size_t lanes = hn::Lanes(d32);
  const auto lane_bit = hn::Mul(hn::Iota(d32, 0), hn::Set(d32, width));
  const auto value_mask = hn::Set(d32, mask);
  const auto seven = hn::Set(d32, 7);
  for (; i + lanes <= n; i += lanes) {
    const size_t bit = i * width;
    const size_t last_byte = (bit + (lanes - 1) * width) / 8;
    if (last_byte + 4 > src_bytes) break;
    const auto bits = hn::Add(hn::Set(d32, static_cast<uint32_t>(bit % 8)), lane_bit);
    const auto bytes = hn::BitCast(di32, hn::ShiftRight<3>(bits));
    const auto words = hn::GatherOffset(d32, reinterpret_cast<const uint32_t*>(src + bit / 8),
                                        bytes);  // byte offsets
    const auto values = hn::And(hn::Shr(words, hn::And(bits, seven)), value_mask);
    hn::StoreU(hn::DemoteTo(d16, hn::BitCast(di32, values)), d16, dst + i);
  }
#endif
  for (; i < n; ++i) {
    const size_t bit = i * width;
    unsigned word = 0;
    const size_t available = std::min<size_t>(3, src_bytes - bit / 8);
    for (size_t b = 0; b < available; ++b) word |= unsigned{src[bit / 8 + b]} << (8 * b);
    dst[i] = static_cast<uint16_t>((word >> (bit % 8)) & mask);
  }
}

void merge_bytes(const unsigned char* low, const unsigned char* high, size_t n, uint16_t* dst) {
  const hn::ScalableTag<uint16_t> d16;
  const hn::Rebind<uint8_t, decltype(d16)> d8;
  const size_t lanes = hn::Lanes(d16);
  size_t i = 0;
  for (; i + lanes <= n; i += lanes) {
    const auto lo = hn::PromoteTo(d16, hn::LoadU(d8, low + i));
    const auto hi = hn::PromoteTo(d16, hn::LoadU(d8, high + i));
    hn::StoreU(hn::Or(lo, hn::ShiftLeft<8>(hi)), d16, dst + i);
  }
  for (; i < n; ++i) dst[i] = static_cast<uint16_t>(low[i] | (high[i] << 8));
}

void widen_bytes(const unsigned char* src, size_t n, uint16_t* dst) {
  const hn::ScalableTag<uint16_t> d16;
  const hn::Rebind<uint8_t, decltype(d16)> d8;
  const size_t lanes = hn::Lanes(d16);
  size_t i = 0;
  for (; i + lanes <= n; i += lanes) {
    hn::StoreU(hn::PromoteTo(d16, hn::LoadU(d8, src + i)), d16, dst + i);
  }
  for (; i < n; ++i) dst[i] = src[i];
}

void undelta(uint16_t* v, size_t n) {
  size_t i = 0;
  uint16_t previous = 0;
#if HWY_TARGET != HWY_SCALAR
  // Prefix sum within 128-bit vectors of eight, then the carry from the vector before.
  const hn::Full128<uint16_t> d;
  const auto one = hn::Set(d, 1);
  auto carry = hn::Zero(d);
  for (; i + 8 <= n; i += 8) {
    const auto z = hn::LoadU(d, v + i);
    auto x = hn::Xor(hn::ShiftRight<1>(z), hn::Sub(hn::Zero(d), hn::And(z, one)));
    x = hn::Add(x, hn::ShiftLeftLanes<1>(d, x));
    x = hn::Add(x, hn::ShiftLeftLanes<2>(d, x));
    x = hn::Add(x, hn::ShiftLeftLanes<4>(d, x));
    x = hn::Add(x, carry);
    hn::StoreU(x, d, v + i);
    carry = hn::Set(d, v[i + 7]);
  }
  if (i > 0) previous = v[i - 1];
#endif
  for (; i < n; ++i) {
    const unsigned z = v[i];
    previous = static_cast<uint16_t>(previous + ((z >> 1) ^ (0u - (z & 1u))));
    v[i] = previous;
  }
}

uint16_t unorder_halves(uint16_t* v, size_t n) {
  const hn::ScalableTag<uint16_t> d;
  const size_t lanes = hn::Lanes(d);
  const auto sign = hn::Set(d, 0x8000);
  const auto magnitude = hn::Set(d, 0x7fff);
  auto largest = hn::Zero(d);
  size_t i = 0;
  for (; i + lanes <= n; i += lanes) {
    const auto x = hn::LoadU(d, v + i);
    // Negative numbers (ordered sign bit clear) have all bits flipped, others only the sign.
    const auto negative = hn::BitCast(
        d, hn::BroadcastSignBit(hn::BitCast(hn::RebindToSigned<decltype(d)>(), hn::Xor(x, sign))));
    const auto bits = hn::Xor(x, hn::Or(sign, negative));
    largest = hn::Max(largest, hn::And(bits, magnitude));
    hn::StoreU(bits, d, v + i);
  }
  HWY_ALIGN uint16_t all[HWY_MAX_BYTES / sizeof(uint16_t)];
  hn::Store(largest, d, all);
  uint16_t best = *std::max_element(all, all + lanes);
  for (; i < n; ++i) {
    v[i] = unorder_half(v[i]);
    best = std::max(best, static_cast<uint16_t>(v[i] & 0x7fffu));
  }
  return best;
}

uint16_t max_value(const uint16_t* v, size_t n) {
  const hn::ScalableTag<uint16_t> d;
  const size_t lanes = hn::Lanes(d);
  uint16_t best = 0;
  size_t i = 0;
  if (n >= lanes) {
    auto m = hn::LoadU(d, v);
    for (i = lanes; i + lanes <= n; i += lanes) m = hn::Max(m, hn::LoadU(d, v + i));
    HWY_ALIGN uint16_t all[HWY_MAX_BYTES / sizeof(uint16_t)];
    hn::Store(m, d, all);
    best = *std::max_element(all, all + lanes);
  }
  for (; i < n; ++i) best = std::max(best, v[i]);
  return best;
}

// Bits 0, 3, 6, .. drawn together. Each step halves the number of gaps.
template <class D64, class V64>
HWY_INLINE V64 morton_coordinate(D64 d, V64 v) {
  v = hn::And(v, hn::Set(d, 0x1249249249249249ull));
  v = hn::And(hn::Xor(v, hn::ShiftRight<2>(v)), hn::Set(d, 0x10c30c30c30c30c3ull));
  v = hn::And(hn::Xor(v, hn::ShiftRight<4>(v)), hn::Set(d, 0x100f00f00f00f00full));
  v = hn::And(hn::Xor(v, hn::ShiftRight<8>(v)), hn::Set(d, 0x001f0000ff0000ffull));
  v = hn::And(hn::Xor(v, hn::ShiftRight<16>(v)), hn::Set(d, 0x001f00000000ffffull));
  return hn::And(hn::Xor(v, hn::ShiftRight<32>(v)), hn::Set(d, 0x1fffffull));
}

void split_morton(const uint64_t* codes, size_t n, uint32_t* const columns[3]) {
  const auto split = [&](auto d, size_t i) HWY_ATTR {
    const hn::Rebind<uint32_t, decltype(d)> d32;
    const auto v = hn::LoadU(d, codes + i);
    const auto x = morton_coordinate(d, v);
    const auto y = morton_coordinate(d, hn::ShiftRight<1>(v));
    const auto z = morton_coordinate(d, hn::ShiftRight<2>(v));
    hn::StoreU(hn::TruncateTo(d32, x), d32, columns[0] + i);
    hn::StoreU(hn::TruncateTo(d32, y), d32, columns[1] + i);
    hn::StoreU(hn::TruncateTo(d32, z), d32, columns[2] + i);
  };
  const hn::ScalableTag<uint64_t> d;
  size_t i = 0;
  for (; i + hn::Lanes(d) <= n; i += hn::Lanes(d)) split(d, i);
  for (; i < n; ++i) split(hn::CappedTag<uint64_t, 1>(), i);
}

void unzigzag(const uint16_t* codes, size_t n, int16_t* values, uint8_t* magnitudes) {
  const auto one_vector = [&](auto d, size_t i) HWY_ATTR {
    const hn::RebindToSigned<decltype(d)> di;
    const hn::Rebind<uint8_t, decltype(d)> d8;
    const auto z = hn::LoadU(d, codes + i);
    const auto odd = hn::And(z, hn::Set(d, 1));
    const auto half = hn::ShiftRight<1>(z);
    hn::StoreU(hn::BitCast(di, hn::Xor(half, hn::Sub(hn::Zero(d), odd))), di, values + i);
    const auto magnitude = hn::Min(hn::Add(half, odd), hn::Set(d, 15));
    hn::StoreU(hn::DemoteTo(d8, hn::BitCast(di, magnitude)), d8, magnitudes + i);
  };
  const hn::ScalableTag<uint16_t> d;
  size_t i = 0;
  for (; i + hn::Lanes(d) <= n; i += hn::Lanes(d)) one_vector(d, i);
  for (; i < n; ++i) one_vector(hn::CappedTag<uint16_t, 1>(), i);
}

void coefficient_contexts(const uint8_t* step_exponent, const uint8_t* last, const uint8_t* before,
                          size_t n, uint8_t* contexts) {
  size_t i = 0;
#if HWY_TARGET != HWY_SCALAR
  // By the sum, of which all from 15 on are alike.
  alignas(16) static constexpr uint8_t kMagnitudes[16] = {0, 1, 1, 2, 2, 2, 2, 3,
                                                          3, 3, 3, 3, 3, 3, 3, 4};
  const hn::ScalableTag<uint8_t> d;
  const auto magnitudes = hn::LoadDup128(d, kMagnitudes);
  for (; i + hn::Lanes(d) <= n; i += hn::Lanes(d)) {
    const auto sum = hn::Add(hn::LoadU(d, last + i), hn::LoadU(d, before + i));
    const auto magnitude = hn::TableLookupBytes(magnitudes, hn::Min(sum, hn::Set(d, 15)));
    const auto c = hn::LoadU(d, step_exponent + i);
    const auto c2 = hn::Add(c, c);
    hn::StoreU(hn::Add(hn::Add(hn::Add(c2, c2), c), magnitude), d, contexts + i);
  }
#endif
  for (; i < n; ++i) {
    const int sum = last[i] + before[i];
    contexts[i] =
        static_cast<uint8_t>(5 * step_exponent[i] + (sum > 0) + (sum > 2) + (sum > 6) + (sum > 14));
  }
}

void map_bytes(const uint8_t* map, size_t entries, const uint8_t* src, size_t n, uint8_t* dst) {
  size_t i = 0;
#if HWY_TARGET != HWY_SCALAR
  const hn::ScalableTag<uint8_t> d;
  for (; i + hn::Lanes(d) <= n; i += hn::Lanes(d)) {
    auto index = hn::LoadU(d, src + i);
    auto found = hn::Zero(d);
    for (size_t at = 0; at < entries; at += 16) {
      // 0..15 become 0x70..0x7f, all others have the top bit set, for which a lookup gives 0. The
      // bits between are cleared: what a lookup gives for 16..0x7f differs between targets.
      const auto here = hn::And(hn::SaturatedAdd(index, hn::Set(d, 0x70)), hn::Set(d, 0x8f));
      found = hn::Or(found, hn::TableLookupBytesOr0(hn::LoadDup128(d, map + at), here));
      index = hn::Sub(index, hn::Set(d, 16));
    }
    hn::StoreU(found, d, dst + i);
  }
#else
  (void)entries;
#endif
  for (; i < n; ++i) dst[i] = map[src[i]];
}

#if HWY_TARGET != HWY_SCALAR
// kKept[mask]: the places of the bits of a mask, then anything.
constexpr auto make_kept() {
  std::array<std::array<uint8_t, 8>, 256> kept{};
  for (size_t mask = 0; mask < 256; ++mask) {
    size_t to = 0;
    for (uint8_t bit = 0; bit < 8; ++bit) {
      if ((mask >> bit & 1) != 0) kept[mask][to++] = bit;
    }
  }
  return kept;
}
#endif

size_t keep_above(uint8_t* const* arrays, size_t num_arrays, size_t n, uint8_t limit) {
  size_t i = 0, to = 0;
#if HWY_TARGET != HWY_SCALAR
  // Eight at a time. Whole groups are written, which reach no further than what has been read.
  static constexpr auto kKept = make_kept();
  const hn::CappedTag<uint8_t, 8> d;
  const hn::RebindToSigned<decltype(d)> di;
  const auto limits = hn::Set(di, static_cast<int8_t>(limit));
  for (; hn::Lanes(d) == 8 && i + 8 <= n; i += 8) {
    uint8_t mask[8];
    const auto values = hn::BitCast(di, hn::LoadU(d, arrays[0] + i));
    hn::StoreMaskBits(di, hn::Gt(values, limits), mask);
    const auto places = hn::LoadU(d, kKept[mask[0]].data());
    for (size_t a = 0; a < num_arrays; ++a) {
      hn::StoreU(hn::TableLookupBytes(hn::LoadU(d, arrays[a] + i), places), d, arrays[a] + to);
    }
    to += hwy::PopCount(mask[0]);
  }
#endif
  for (; i < n; ++i) {
    const bool keep = arrays[0][i] > limit;
    for (size_t a = 0; a < num_arrays; ++a) arrays[a][to] = arrays[a][i];
    to += keep;
  }
  return to;
}

const StreamKernels* kernels() {
  static constexpr StreamKernels kKernels = {
      unpack_bits,  merge_bytes, widen_bytes,          undelta,   unorder_halves, max_value,
      split_morton, unzigzag,    coefficient_contexts, map_bytes, keep_above};
  return &kKernels;
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace l4d
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace l4d {
HWY_EXPORT(kernels);
const StreamKernels& stream_kernels_simd() { return *HWY_DYNAMIC_DISPATCH(kernels)(); }
}  // namespace l4d
#endif
