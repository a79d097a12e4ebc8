// SPDX-License-Identifier: Apache-2.0
#include <cstring>
#include <limits>

#include "decoder/expand/reconstruct.h"
#include "libl4dcodec/base/half.h"
#include "libl4dcodec/container/scene_header.h"
#include "libl4dcodec/math/rotor.h"
#include "libl4dcodec/scene/attributes.h"
#include "libl4dcodec/scene/layers.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "decoder/expand/reconstruct_simd.cc"
#include <hwy/foreach_target.h>
#include <hwy/cache_control.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace l4d {
namespace HWY_NAMESPACE {
namespace {
namespace hn = hwy::HWY_NAMESPACE;

// binary16 bits to binary32, finite values. Integer form, so that every target gives the same bits
// whatever its conversion instructions and its flush-to-zero mode do with subnormal halves: these
// are made by an exact conversion of the integer mantissa.
template <class D32, class V16>
HWY_INLINE hn::Vec<D32> halves_to_floats(D32 df, V16 halves) {
  const hn::RebindToUnsigned<D32> du;
  const hn::RebindToSigned<D32> di;
  const auto bits = hn::PromoteTo(du, halves);
  const auto sign = hn::ShiftLeft<16>(hn::And(bits, hn::Set(du, 0x8000)));
  const auto magnitude = hn::And(bits, hn::Set(du, 0x7fff));
  const auto normal = hn::Add(hn::ShiftLeft<13>(magnitude), hn::Set(du, uint32_t{127 - 15} << 23));
  const auto subnormal = hn::BitCast(
      du, hn::Mul(hn::ConvertTo(df, hn::BitCast(di, magnitude)), hn::Set(df, 1.0f / 16777216.0f)));
  const auto is_normal = hn::Gt(hn::BitCast(di, magnitude), hn::Set(di, 0x03ff));
  const auto value = hn::IfThenElse(hn::RebindMask(du, is_normal), normal, subnormal);
  return hn::BitCast(df, hn::Or(sign, value));
}

void positions(const uint16_t* const columns[3], size_t n, const float center[3], float scale,
               float* dst) {
  const hn::ScalableTag<float> df;
  const hn::Rebind<uint16_t, decltype(df)> dh;
  const size_t lanes = hn::Lanes(df);
  const auto vscale = hn::Set(df, scale);
  const auto cx = hn::Set(df, center[0]);
  const auto cy = hn::Set(df, center[1]);
  const auto cz = hn::Set(df, center[2]);
  size_t i = 0;
  for (; i + lanes <= n; i += lanes) {
    const auto x = halves_to_floats(df, hn::LoadU(dh, columns[0] + i));
    const auto y = halves_to_floats(df, hn::LoadU(dh, columns[1] + i));
    const auto z = halves_to_floats(df, hn::LoadU(dh, columns[2] + i));
    hn::StoreInterleaved3(hn::Add(cx, hn::Mul(vscale, x)), hn::Add(cy, hn::Mul(vscale, y)),
                          hn::Add(cz, hn::Mul(vscale, z)), df, dst + 3 * i);
  }
  for (; i < n; ++i) {
    for (size_t axis = 0; axis < 3; ++axis) {
      dst[3 * i + axis] = center[axis] + scale * half_to_float(columns[axis][i]);
    }
  }
}

void means(const uint16_t* halves, size_t n, float width, float* dst) {
  const hn::ScalableTag<float> df;
  const hn::Rebind<uint16_t, decltype(df)> dh;
  const size_t lanes = hn::Lanes(df);
  const auto w = hn::Set(df, width);
  size_t i = 0;
  for (; i + lanes <= n; i += lanes) {
    hn::StoreU(hn::Mul(w, halves_to_floats(df, hn::LoadU(dh, halves + i))), df, dst + i);
  }
  for (; i < n; ++i) dst[i] = width * half_to_float(halves[i]);
}

void fixed_means(const uint16_t* codes, const uint16_t* fine, size_t n, float step, uint32_t zero,
                 float* dst) {
  const hn::ScalableTag<float> df;
  const hn::RebindToSigned<decltype(df)> di;
  const hn::Rebind<uint16_t, decltype(df)> dh;
  const size_t lanes = hn::Lanes(df);
  const auto steps = hn::Set(df, step);
  const auto zeros = hn::Set(di, static_cast<int32_t>(zero));
  const auto one = hn::Set(di, 1);
  const auto exponents = hn::Set(di, 0x7f800000), ones = hn::Set(di, 0x3f800000);
  const auto of_half_cell = hn::Set(di, 253 << 23);
  size_t i = 0;
  for (; i + lanes <= n; i += lanes) {
    const auto code = hn::PromoteTo(di, hn::LoadU(dh, codes + i));
    auto place = hn::ConvertTo(df, hn::Sub(code, zeros));
    if (fine != nullptr) {
      // r = 2^k * m with m in [1, 2): the part is (m - 1.5) + 2^-(k + 1), all exact.
      const auto r = hn::Add(hn::PromoteTo(di, hn::LoadU(dh, fine + i)), one);
      const auto bits = hn::BitCast(di, hn::ConvertTo(df, r));
      const auto exponent = hn::And(bits, exponents);
      const auto m = hn::BitCast(df, hn::Or(hn::AndNot(exponents, bits), ones));
      const auto half_cell = hn::BitCast(df, hn::Sub(of_half_cell, exponent));
      place = hn::Add(place, hn::Add(hn::Sub(m, hn::Set(df, 1.5f)), half_cell));
    }
    hn::StoreU(hn::Mul(steps, place), df, dst + i);
  }
  for (; i < n; ++i) {
    dst[i] = fixed_mean_time(step, zero, codes[i], fine == nullptr ? uint16_t{0} : fine[i]);
  }
}

void absolute_means(const float* local, size_t n, double center, float* dst) {
  size_t i = 0;
#if HWY_HAVE_FLOAT64 && HWY_TARGET != HWY_SCALAR
  const hn::ScalableTag<double> dd;
  const hn::Rebind<float, decltype(dd)> df;
  const auto centers = hn::Set(dd, center);
  for (; i + hn::Lanes(dd) <= n; i += hn::Lanes(dd)) {
    const auto sum = hn::Add(centers, hn::PromoteTo(dd, hn::LoadU(df, local + i)));
    hn::StoreU(hn::DemoteTo(df, sum), df, dst + i);
  }
#endif
  for (; i < n; ++i) dst[i] = static_cast<float>(center + static_cast<double>(local[i]));
}

void scalars(const uint16_t* codes, size_t n, float offset, float step, float* dst) {
  const hn::ScalableTag<float> df;
  const hn::RebindToSigned<decltype(df)> di;
  const hn::Rebind<uint16_t, decltype(df)> dh;
  const size_t lanes = hn::Lanes(df);
  const auto o = hn::Set(df, offset);
  const auto st = hn::Set(df, step);
  size_t i = 0;
  for (; i + lanes <= n; i += lanes) {
    const auto code = hn::ConvertTo(df, hn::PromoteTo(di, hn::LoadU(dh, codes + i)));
    hn::StoreU(hn::Add(o, hn::Mul(st, code)), df, dst + i);
  }
  for (; i < n; ++i) dst[i] = offset + step * static_cast<float>(codes[i]);
}

// Copies one codeword. Whole vectors first, the rest by single floats: dst may end with the row.
template <class D>
HWY_INLINE void copy_row(D d, const float* HWY_RESTRICT row, size_t dim, float* HWY_RESTRICT dst) {
  size_t k = 0;
  for (; k + hn::Lanes(d) <= dim; k += hn::Lanes(d)) hn::StoreU(hn::LoadU(d, row + k), d, dst + k);
  for (; k < dim; ++k) dst[k] = row[k];
}

template <class D>
HWY_INLINE void add_row(D d, const float* HWY_RESTRICT row, size_t dim, float* HWY_RESTRICT dst) {
  size_t k = 0;
  for (; k + hn::Lanes(d) <= dim; k += hn::Lanes(d)) {
    hn::StoreU(hn::Add(hn::LoadU(d, dst + k), hn::LoadU(d, row + k)), d, dst + k);
  }
  for (; k < dim; ++k) dst[k] = dst[k] + row[k];
}

// Writing around the cache saves reading every line of the destination first. Needs alignment,
// which whole rows keep.
HWY_INLINE bool can_stream(bool past_cache, const float* dst) {
  return past_cache && reinterpret_cast<uintptr_t>(dst) % (4 * sizeof(float)) == 0;
}

// The SH codebook is larger than the second-level cache, so rows are fetched a little ahead.
constexpr size_t kPrefetchRows = 8;

template <class D>
HWY_INLINE void stream_rows(D d, const uint16_t* HWY_RESTRICT index,
                            const float* HWY_RESTRICT codebook, size_t n, size_t dim,
                            float* HWY_RESTRICT dst) {
  for (size_t i = 0; i < n; ++i, dst += dim) {
    const float* HWY_RESTRICT row = codebook + dim * index[i];
    const float* ahead = codebook + dim * index[i + kPrefetchRows < n ? i + kPrefetchRows : i];
    for (size_t k = 0; k < dim; k += 16) hwy::Prefetch(ahead + k);
    for (size_t k = 0; k < dim; k += hn::Lanes(d)) hn::Stream(hn::LoadU(d, row + k), d, dst + k);
  }
  hwy::FlushStream();
}

template <class D>
HWY_INLINE void vq_rows_with(D d, const VqSource& source, size_t dim, VqCursor& cursor,
                             size_t begin, size_t end, float* dst, bool past_cache) {
  if (source.depth == nullptr && source.num_stages == 1) {
    const uint16_t* HWY_RESTRICT index = source.index[0] + cursor.index[0];
    const float* HWY_RESTRICT codebook = source.codebook[0];
    const hn::CappedTag<float, 4> d4;
    if (dim % 16 == 0 && can_stream(past_cache, dst)) {
      stream_rows(d4, index, codebook, end - begin, dim, dst);
      cursor.index[0] += end - begin;
      return;
    }
    for (size_t i = 0; i < end - begin; ++i)
      copy_row(d, codebook + dim * index[i], dim, dst + dim * i);
    cursor.index[0] += end - begin;
    return;
  }
  for (size_t i = begin; i < end; ++i, dst += dim) {
    const size_t depth = source.depth == nullptr ? source.num_stages : source.depth[i];
    if (depth == kEscapeDepth) {
      const uint16_t* row = source.escape + dim * cursor.escape++;
      for (size_t k = 0; k < dim; ++k) dst[k] = half_to_float(row[k]);
    } else if (depth == 0) {
      std::memset(dst, 0, dim * sizeof(float));
    } else {
      copy_row(d, source.codebook[0] + dim * source.index[0][cursor.index[0]++], dim, dst);
      for (size_t s = 1; s < depth; ++s) {
        add_row(d, source.codebook[s] + dim * source.index[s][cursor.index[s]++], dim, dst);
      }
    }
  }
}

// Rows of three in one load and one store each: the fourth number is overwritten by the next row.
// The last row must not reach beyond its end. (A codebook is padded, so the load always stays
// inside.)
void copy_rows_of_3(const VqSource& source, VqCursor& cursor, size_t begin, size_t end,
                    float* dst) {
  const hn::CappedTag<float, 4> d;
  const uint16_t* HWY_RESTRICT index = source.index[0] + cursor.index[0];
  const float* HWY_RESTRICT codebook = source.codebook[0];
  const size_t n = end - begin;
  for (size_t i = 0; i < n; ++i) {
    const float* row = codebook + 3 * size_t{index[i]};
    if (hn::Lanes(d) == 4 && i + 1 < n) {
      hn::StoreU(hn::LoadU(d, row), d, dst + 3 * i);
    } else {
      for (size_t k = 0; k < 3; ++k) dst[3 * i + k] = row[k];
    }
  }
  cursor.index[0] += n;
}

void vq_rows(const VqSource& source, VqCursor& cursor, size_t begin, size_t end, float* dst,
             bool past_cache) {
  // Constants let the compiler unroll the rows that occur in practice.
  switch (source.dim) {
    case 3:
      if (source.depth == nullptr && source.num_stages == 1) {
        return copy_rows_of_3(source, cursor, begin, end, dst);
      }
      break;
    case 4:
      return vq_rows_with(hn::CappedTag<float, 4>(), source, 4, cursor, begin, end, dst,
                          past_cache);
    case 12:
      return vq_rows_with(hn::CappedTag<float, 4>(), source, 12, cursor, begin, end, dst,
                          past_cache);
    case 48:
      return vq_rows_with(hn::ScalableTag<float>(), source, 48, cursor, begin, end, dst,
                          past_cache);
    case 27:
      return vq_rows_with(hn::CappedTag<float, 4>(), source, 27, cursor, begin, end, dst, false);
    default:
      break;
  }
  vq_rows_with(hn::CappedTag<float, 4>(), source, source.dim, cursor, begin, end, dst, false);
}

void log_scales(const float* factor, const float* normalized, size_t n, float* dst,
                bool past_cache) {
  const hn::CappedTag<float, 4> d;
  const bool stream = can_stream(past_cache, dst);
  const auto low = hn::Set(d, -kMaxLogScale), high = hn::Set(d, kMaxLogScale);
  for (size_t i = 0; i < n; ++i) {
    const auto f = hn::Set(d, factor[i]);
    for (size_t k = 0; k < 4; k += hn::Lanes(d)) {
      const auto sum = hn::Add(f, hn::LoadU(d, normalized + 4 * i + k));
      const auto v = hn::Min(hn::Max(sum, low), high);
      if (stream) {
        hn::Stream(v, d, dst + 4 * i + k);
      } else {
        hn::StoreU(v, d, dst + 4 * i + k);
      }
    }
  }
  if (stream) hwy::FlushStream();
}

#if HWY_TARGET == HWY_SCALAR

void rotors(const float* spatial, const float* temporal, size_t n, float* dst, bool) {
  for (size_t i = 0; i < n; ++i) {
    float rotor[8];
    std::memcpy(rotor, spatial + 4 * i, 4 * sizeof(float));
    std::memcpy(rotor + 4, temporal + 4 * i, 4 * sizeof(float));
    normalize_rotor(rotor, dst + 8 * i);
  }
}

#else

alignas(16) constexpr float kSigns[4] = {0.0f, -0.0f, 0.0f, -0.0f};

// Each block of four lanes divided by its length, or (1, 0, 0, 0) where that vanishes.
template <class D>
HWY_INLINE hn::Vec<D> normalize_blocks(D d, hn::Vec<D> v) {
  alignas(16) static constexpr float kIdentity[4] = {1.0f, 0.0f, 0.0f, 0.0f};
  const auto squares = hn::Mul(v, v);
  // ((0 + 1) + (2 + 3)) in every lane: addition commutes, so the swapped lanes agree.
  const auto pairs = hn::Add(squares, hn::Shuffle2301(squares));
  const auto norm2 = hn::Add(pairs, hn::Shuffle1032(pairs));
  return hn::IfThenElse(hn::Lt(norm2, hn::Set(d, 1e-12f)), hn::LoadDup128(d, kIdentity),
                        hn::Div(v, hn::Sqrt(norm2)));
}

// With Q = (p, -b23, b13, -b03), the reversed temporal half with alternating signs, A = S + Q and
// B = S - Q; x + (-y) and x - y are the same bits. Both halves go through one vector where it is
// wide enough: division and square root are what costs here.
HWY_INLINE void normalize_pair(hn::Vec128<float> s, hn::Vec128<float> q, hn::Vec128<float>& a,
                               hn::Vec128<float>& b) {
  const hn::Full128<float> d;
#if HWY_TARGET <= HWY_AVX2
  const hn::FixedTag<float, 8> d2;
  const auto both = normalize_blocks(d2, hn::Combine(d2, hn::Sub(s, q), hn::Add(s, q)));
  a = hn::LowerHalf(d, both);
  b = hn::UpperHalf(d, both);
#else
  a = normalize_blocks(d, hn::Add(s, q));
  b = normalize_blocks(d, hn::Sub(s, q));
#endif
}

void rotors(const float* spatial, const float* temporal, size_t n, float* dst, bool past_cache) {
  const hn::Full128<float> d;
  const auto signs = hn::Load(d, kSigns);
  const auto half = hn::Set(d, 0.5f);
  const bool stream = can_stream(past_cache, dst);
  for (size_t i = 0; i < n; ++i) {
    const auto s = hn::LoadU(d, spatial + 4 * i);
    const auto q = hn::Xor(hn::Reverse(d, hn::LoadU(d, temporal + 4 * i)), signs);
    hn::Vec128<float> a, b;
    normalize_pair(s, q, a, b);
    const auto first = hn::Mul(hn::Add(a, b), half);
    // p = A0 - B0 and b13 = A2 - B2, but b23 = B1 - A1 and b03 = B3 - A3: signs before subtracting.
    const auto difference = hn::Sub(hn::Xor(a, signs), hn::Xor(b, signs));
    const auto second = hn::Reverse(d, hn::Mul(difference, half));
    if (stream) {
      hn::Stream(first, d, dst + 8 * i);
      hn::Stream(second, d, dst + 8 * i + 4);
    } else {
      hn::StoreU(first, d, dst + 8 * i);
      hn::StoreU(second, d, dst + 8 * i + 4);
    }
  }
  if (stream) hwy::FlushStream();
}

#endif  // HWY_TARGET == HWY_SCALAR

void halves(const float* from, size_t n, uint16_t* dst) {
  const hn::ScalableTag<float> df;
  const hn::RebindToSigned<decltype(df)> di;
  const hn::Rebind<uint16_t, decltype(df)> dh;
  const size_t lanes = hn::Lanes(df);
  size_t i = 0;
  for (; i + lanes <= n; i += lanes) {
    const auto bits = hn::BitCast(di, hn::LoadU(df, from + i));
    const auto sign = hn::And(bits, hn::Set(di, std::numeric_limits<int32_t>::min()));
    const auto magnitude =
        hn::Min(hn::AndNot(hn::Set(di, std::numeric_limits<int32_t>::min()), bits),
                hn::Set(di, 0x477fe000));
#if HWY_TARGET <= HWY_AVX2 && !defined(HWY_DISABLE_F16C)
    // The instruction rounds to the nearest, and knows no mode that flushes what is subnormal.
    const hn::Rebind<hwy::float16_t, decltype(df)> d16;
    hn::StoreU(hn::BitCast(dh, hn::DemoteTo(d16, hn::BitCast(df, hn::Or(sign, magnitude)))), dh,
               dst + i);
#else
    const auto odd = hn::And(hn::ShiftRight<13>(magnitude), hn::Set(di, 1));
    const auto normal =
        hn::ShiftRight<13>(hn::Add(hn::Add(magnitude, odd), hn::Set(di, 0xfff - 0x38000000)));
    // The last bit of 0.5 is that of subnormal halves.
    const auto subnormal =
        hn::Sub(hn::BitCast(di, hn::Add(hn::BitCast(df, magnitude), hn::Set(df, 0.5f))),
                hn::Set(di, 0x3f000000));
    const auto half = hn::IfThenElse(hn::Lt(magnitude, hn::Set(di, 0x38800000)), subnormal, normal);
    const hn::RebindToUnsigned<decltype(df)> du;
    const auto high = hn::BitCast(di, hn::ShiftRight<16>(hn::BitCast(du, sign)));
    hn::StoreU(hn::DemoteTo(dh, hn::Or(high, half)), dh, dst + i);
#endif
  }
  floats_to_halves(from + i, n - i, dst + i);
}

const ReconstructKernels* kernels() {
  static constexpr ReconstructKernels kKernels = {
      positions, means, fixed_means, absolute_means, scalars, vq_rows, log_scales, rotors, halves};
  return &kKernels;
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace l4d
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace l4d {
HWY_EXPORT(kernels);
const ReconstructKernels& reconstruct_kernels_simd() { return *HWY_DYNAMIC_DISPATCH(kernels)(); }
}  // namespace l4d
#endif
