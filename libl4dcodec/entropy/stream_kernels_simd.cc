// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstring>

#include "libl4dcodec/entropy/stream_kernels.h"
#include "libl4dcodec/base/ordered.h"

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
    const auto words = hn::GatherOffset(
        d32, reinterpret_cast<const uint32_t*>(src + bit / 8), bytes);  // byte offsets
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

const StreamKernels* kernels() {
  static constexpr StreamKernels kKernels = {unpack_bits, merge_bytes, widen_bytes, undelta,
                                             unorder_halves, max_value};
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
