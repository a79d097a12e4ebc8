// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cstring>

#include "decoder/expand/transform.h"
#include "libl4dcodec/container/page.h"
#include "libl4dcodec/math/rotor.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "decoder/expand/transform_simd.cc"
#include <hwy/foreach_target.h>
#include <hwy/cache_control.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace l4d {
namespace HWY_NAMESPACE {
namespace {
#if HWY_TARGET == HWY_SCALAR || HWY_HAVE_SCALABLE
// Rows are held in arrays of vectors, which vectors of unknown size cannot form.
const TransformKernels* kernels() { return &transform_kernels_reference(); }
#else
namespace hn = hwy::HWY_NAMESPACE;

using D = hn::ScalableTag<float>;
using V = hn::Vec<D>;
constexpr size_t kWidth = HWY_LANES(float);
constexpr size_t kMaxDim = 48;
constexpr size_t kBatch = 64;

HWY_INLINE bool can_stream(bool past_cache, const float* dst) {
  return past_cache && reinterpret_cast<uintptr_t>(dst) % (4 * sizeof(float)) == 0;
}

// To stream, dst must lie at a multiple of 16 bytes. The caller flushes.
HWY_INLINE void copy_out(const float* HWY_RESTRICT src, size_t n, bool stream,
                         float* HWY_RESTRICT dst) {
  if (!stream) {
    std::memcpy(dst, src, n * sizeof(float));
    return;
  }
  const D d;
  const hn::Full128<float> d4;
  size_t i = 0;
  for (; i + 4 <= n && reinterpret_cast<uintptr_t>(dst + i) % sizeof(V) != 0; i += 4) {
    hn::Stream(hn::LoadU(d4, src + i), d4, dst + i);
  }
  for (; i + kWidth <= n; i += kWidth) hn::Stream(hn::LoadU(d, src + i), d, dst + i);
  for (; i + 4 <= n; i += 4) hn::Stream(hn::LoadU(d4, src + i), d4, dst + i);
  for (; i < n; ++i) dst[i] = src[i];
}

HWY_INLINE V load_int16(const int16_t* q) {
  const D d;
  const hn::RebindToSigned<D> di;
  const hn::Rebind<int16_t, D> d16;
  return hn::ConvertTo(d, hn::PromoteTo(di, hn::LoadU(d16, q)));
}

// 2^-step_exponent
HWY_INLINE V step_scales(const uint8_t* step_exponent) {
  const D d;
  const hn::RebindToUnsigned<D> du;
  const hn::Rebind<uint8_t, D> d8;
  const auto exponent = hn::Sub(hn::Set(du, 127), hn::PromoteTo(du, hn::LoadU(d8, step_exponent)));
  return hn::BitCast(d, hn::ShiftLeft<23>(exponent));
}

float step_scale(uint8_t step_exponent) { return 1.0f / static_cast<float>(1u << step_exponent); }

using DI = hn::RebindToSigned<D>;
using VI = hn::Vec<DI>;
using D16 = hn::Repartition<int16_t, D>;
using V16 = hn::Vec<D16>;

// Lane by lane a[2i] * b[2i] + a[2i + 1] * b[2i + 1] of 16-bit numbers, modulo 2^32.
HWY_INLINE VI multiply_pairs(V16 a, V16 b) {
#if HWY_ARCH_X86 && HWY_TARGET <= HWY_AVX3
  return VI{_mm512_madd_epi16(a.raw, b.raw)};
#elif HWY_ARCH_X86 && HWY_TARGET == HWY_AVX2
  return VI{_mm256_madd_epi16(a.raw, b.raw)};
#elif HWY_ARCH_X86 && (HWY_TARGET == HWY_SSE4 || HWY_TARGET == HWY_SSSE3)
  return VI{_mm_madd_epi16(a.raw, b.raw)};
#elif HWY_TARGET == HWY_WASM
  return VI{wasm_i32x4_dot_i16x8(a.raw, b.raw)};
#elif HWY_TARGET == HWY_NEON && HWY_ARCH_ARM_A64
  return VI{vpaddq_s32(vmull_s16(vget_low_s16(a.raw), vget_low_s16(b.raw)),
                       vmull_high_s16(a.raw, b.raw))};
#else
  const DI d;
  const VI a2 = hn::BitCast(d, a), b2 = hn::BitCast(d, b);
  const auto even = [](VI v) HWY_ATTR { return hn::ShiftRight<16>(hn::ShiftLeft<16>(v)); };
  return hn::Add(hn::Mul(even(a2), even(b2)),
                 hn::Mul(hn::ShiftRight<16>(a2), hn::ShiftRight<16>(b2)));
#endif
}

// How many sums fit in the registers, besides factors.
#if HWY_TARGET <= HWY_AVX3 || HWY_ARCH_ARM_A64
constexpr size_t kMaxVectors = 3;
#else
constexpr size_t kMaxVectors = 2;
#endif

// Who has an EOB index above `step`. Both are small enough for signed comparisons.
HWY_INLINE uint64_t eob_indices_above(const uint8_t* HWY_RESTRICT eob_index, size_t step) {
  const hn::CappedTag<int8_t, kBatch> d8;
  const auto steps = hn::Set(d8, static_cast<int8_t>(step));
  uint64_t mask = 0;
  for (size_t i = 0; i < kBatch; i += hn::Lanes(d8)) {
    uint8_t bits[8] = {};
    const auto eob_indices = hn::LoadU(d8, reinterpret_cast<const int8_t*>(eob_index + i));
    hn::StoreMaskBits(d8, hn::Gt(eob_indices, steps), bits);
    uint64_t part;
    std::memcpy(&part, bits, sizeof(part));
    mask |= part << i;
  }
  return mask;
}

// Gaussians that are worked on together, with whole vectors for each row. Bit i of a mask is
// Gaussian i. Coefficients are taken two at a time: a step of the EOB table with an odd number of
// them has a zero behind the last.
struct IntegerBatch {
  static constexpr size_t kSize = kBatch;
  static constexpr size_t kPairs = kMaxDim;  // at most: every step may have one coefficient
  HWY_ALIGN float rows[kSize * kMaxDim];
  HWY_ALIGN int32_t basis[kPairs * kMaxDim];  // [pairs, stride], two numbers in each
  HWY_ALIGN float origin[kMaxDim];
  HWY_ALIGN int32_t q[kPairs][kSize];  // 0 where a Gaussian does not reach the pair
  HWY_ALIGN float scale[kSize];
  uint8_t step_exponent[kSize];
  uint8_t eob_index[kSize];
  // The Gaussians by the number of their pairs, and that number.
  size_t num_ordered;
  uint8_t order[kSize + 4];
  uint8_t pairs[kSize + 4];
};

// Numbers of `kVectors` vectors of the rows of the Gaussians at `order`.
template <size_t kGroup, size_t kVectors>
HWY_INLINE void integer_columns(size_t pairs, const uint8_t* order, size_t column, size_t stride,
                                IntegerBatch& batch) {
  const D d;
  const DI di;
  const D16 d16;
  VI sum[kGroup][kVectors];
  for (size_t v = 0; v < kVectors; ++v) {
    for (size_t g = 0; g < kGroup; ++g) sum[g][v] = hn::Zero(di);
  }
  const int32_t* HWY_RESTRICT vector = batch.basis + column;
  const int32_t* HWY_RESTRICT q[kGroup];
  for (size_t g = 0; g < kGroup; ++g) q[g] = batch.q[0] + order[g];
  for (size_t at = 0; at < pairs * kBatch; at += kBatch, vector += stride) {
    V16 b[kVectors];
    for (size_t v = 0; v < kVectors; ++v) {
      b[v] = hn::BitCast(d16, hn::Load(di, vector + v * kWidth));
    }
    for (size_t g = 0; g < kGroup; ++g) {
      const V16 a = hn::BitCast(d16, hn::Set(di, q[g][at]));
      for (size_t v = 0; v < kVectors; ++v) {
        sum[g][v] = hn::Add(sum[g][v], multiply_pairs(a, b[v]));
      }
    }
  }
  for (size_t g = 0; g < kGroup; ++g) {
    const V scale = hn::Set(d, batch.scale[order[g]]);
    float* HWY_RESTRICT dst = batch.rows + stride * order[g] + column;
    for (size_t v = 0; v < kVectors; ++v) {
      const V offset = hn::Mul(hn::ConvertTo(d, sum[g][v]), scale);
      hn::Store(hn::Add(hn::Load(d, batch.origin + column + v * kWidth), offset), d,
                dst + v * kWidth);
    }
  }
}

// All rows of a batch, those of alike length side by side. A group has as many pairs as its last
// member; those of others are 0 there.
HWY_NOINLINE void ordered_rows(size_t stride, IntegerBatch& batch) {
  constexpr size_t kGroup = 4;
  size_t n = batch.num_ordered;
  // The last Gaussian again, up to a whole group.
  for (; n % kGroup != 0; ++n) {
    batch.order[n] = batch.order[n - 1];
    batch.pairs[n] = batch.pairs[n - 1];
  }
  for (size_t i = 0; i < n; i += kGroup) {
    const uint8_t* order = batch.order + i;
    const size_t pairs = batch.pairs[i + kGroup - 1];
    size_t column = 0;
    for (; column + kMaxVectors * kWidth <= stride; column += kMaxVectors * kWidth) {
      integer_columns<kGroup, kMaxVectors>(pairs, order, column, stride, batch);
    }
    const size_t left = (stride - column) / kWidth;
    if (left == 1) integer_columns<kGroup, 1>(pairs, order, column, stride, batch);
    if (left == 2) integer_columns<kGroup, 2>(pairs, order, column, stride, batch);
  }
}

#if HWY_TARGET > HWY_AVX3
// Bytes of the words that go to each lane whose bit is set in a mask; 0x80 = zero.
constexpr auto make_places() {
  std::array<std::array<uint8_t, 16>, 16> bytes{};
  for (size_t mask = 0; mask < 16; ++mask) {
    uint8_t at = 0;
    for (size_t lane = 0; lane < 4; ++lane) {
      const bool used = (mask >> lane & 1) != 0;
      for (size_t b = 0; b < 4; ++b) {
        bytes[mask][4 * lane + b] = used ? static_cast<uint8_t>(at + b) : uint8_t{0x80};
      }
      at = static_cast<uint8_t>(at + (used ? 4 : 0));
    }
  }
  return bytes;
}
#endif

// The first numbers of v in the lanes whose bits are set, in order, and zeros in the others.
#if HWY_TARGET <= HWY_AVX3
constexpr size_t kSpread = kWidth;
using DSpread = DI;
HWY_INLINE hn::Vec<DSpread> spread(uint64_t bits, hn::Vec<DSpread> v) {
  // Highway 1.0 has no Expand.
  return VI{_mm512_maskz_expand_epi32(static_cast<__mmask16>(bits), v.raw)};
}
#else
constexpr size_t kSpread = 4;
using DSpread = hn::Full128<int32_t>;
HWY_INLINE hn::Vec<DSpread> spread(uint64_t bits, hn::Vec<DSpread> v) {
  static constexpr auto kPlaces = make_places();
  const hn::Full128<uint8_t> d8;
  const auto places = hn::LoadU(d8, kPlaces[bits].data());
  return hn::BitCast(DSpread(), hn::TableLookupBytesOr0(hn::BitCast(d8, v), places));
}
#endif

static_assert(kSpread <= kCoefficientPadding, "columns end sooner");

// Two columns of coefficients side by side, at the Gaussians of `reach`; `second` null is zeros.
// Columns are read up to a whole vector.
HWY_INLINE void pair_up(const int16_t* HWY_RESTRICT first, const int16_t* HWY_RESTRICT second,
                        uint64_t reach, int32_t* HWY_RESTRICT to) {
  const DSpread di;
  const hn::RebindToUnsigned<DSpread> du;
  const hn::Rebind<uint16_t, DSpread> d16;
  const auto widen = [&](const int16_t* q) HWY_ATTR {
    return hn::PromoteTo(du, hn::LoadU(d16, reinterpret_cast<const uint16_t*>(q)));
  };
  for (size_t i = 0, at = 0; i < kBatch; i += kSpread, reach >>= kSpread) {
    auto pair = widen(first + at);
    if (second != nullptr) pair = hn::Or(pair, hn::ShiftLeft<16>(widen(second + at)));
    const uint64_t bits = reach & ((uint64_t{1} << kSpread) - 1);
    hn::Store(spread(bits, hn::BitCast(di, pair)), di, to + i);
    at += hwy::PopCount(bits);
  }
}

HWY_INLINE void put_in_order(uint64_t members, size_t pairs, IntegerBatch& batch) {
  size_t n = batch.num_ordered;
  for (; members != 0; members &= members - 1) {
    batch.order[n] = static_cast<uint8_t>(hwy::Num0BitsBelowLS1Bit_Nonzero64(members));
    batch.pairs[n++] = static_cast<uint8_t>(pairs);
  }
  batch.num_ordered = n;
}

HWY_NOINLINE void integer_batch(const TransformSource& source, TransformCursor& cursor,
                                const uint8_t* eob_table, size_t n, size_t stride,
                                IntegerBatch& batch) {
  const D d;
  for (size_t i = 0; i < IntegerBatch::kSize; i += kWidth) {
    hn::Store(hn::Mul(step_scales(batch.step_exponent + i), hn::Set(d, source.integer_scale)), d,
              batch.scale + i);
  }
  uint64_t members = ~uint64_t{0} >> (IntegerBatch::kSize - n);
  batch.num_ordered = 0;
  size_t p = 0;
  for (size_t k = 0, s = 0; k < source.num_coefficients && members != 0; ++s) {
    const uint64_t reach = members & eob_indices_above(batch.eob_index, s);
    put_in_order(members ^ reach, p, batch);
    members = reach;
    const size_t count = hwy::PopCount(members);
    for (; k < eob_table[s]; k += 2, ++p) {
      const bool two = k + 1 < eob_table[s];
      pair_up(source.coefficient[k] + cursor.coefficient[k],
              two ? source.coefficient[k + 1] + cursor.coefficient[k + 1] : nullptr, members,
              batch.q[p]);
      cursor.coefficient[k] += count;
      if (two) cursor.coefficient[k + 1] += count;
    }
    k = eob_table[s];
  }
  put_in_order(members, p, batch);
  ordered_rows(stride, batch);
}

void integer_rows(const TransformSource& source, TransformCursor& cursor, size_t begin, size_t end,
                  float* dst, bool past_cache) {
  const size_t dim = source.dim;
  const size_t stride = hwy::RoundUpTo(dim, kWidth);
  const bool stream = can_stream(past_cache, dst);
  const uint8_t all = static_cast<uint8_t>(source.num_coefficients);
  const uint8_t* eob_table = source.eob_index == nullptr ? &all : source.eob_table;
  IntegerBatch batch;
  std::fill_n(batch.step_exponent, IntegerBatch::kSize, uint8_t{0});
  std::fill_n(batch.eob_index, IntegerBatch::kSize, uint8_t{1});
  std::fill_n(batch.origin, kMaxDim, 0.0f);
  std::copy_n(source.basis, dim, batch.origin);
  for (size_t s = 0, k = 0, p = 0; k < source.num_coefficients; ++s) {
    for (; k < eob_table[s]; k += 2, ++p) {
      const bool two = k + 1 < eob_table[s];
      for (size_t c = 0; c < stride; ++c) {
        const bool there = c < dim;
        const uint16_t low = there ? static_cast<uint16_t>(source.integer_basis[dim * k + c]) : 0;
        const uint16_t high =
            there && two ? static_cast<uint16_t>(source.integer_basis[dim * (k + 1) + c]) : 0;
        batch.basis[p * stride + c] = static_cast<int32_t>(uint32_t{high} << 16 | low);
      }
    }
    k = eob_table[s];
  }
  for (size_t i = begin; i < end; i += IntegerBatch::kSize) {
    const size_t n = std::min(IntegerBatch::kSize, end - i);
    std::copy_n(source.step_exponent + i, n, batch.step_exponent);
    if (source.eob_index != nullptr) std::copy_n(source.eob_index + i, n, batch.eob_index);
    integer_batch(source, cursor, eob_table, n, stride, batch);
    for (size_t j = 1; j < n && stride != dim; ++j) {
      for (size_t c = 0; c < dim; ++c) batch.rows[j * dim + c] = batch.rows[j * stride + c];
    }
    copy_out(batch.rows, n * dim, stream, dst);
    dst += n * dim;
  }
  if (stream) hwy::FlushStream();
}

// Rows of three or four numbers with all coefficients, a vector of Gaussians at a time.
template <size_t kDim>
void rows_of(const TransformSource& source, TransformCursor& cursor, size_t begin, size_t end,
             float* dst) {
  const D d;
  const size_t n = end - begin;
  const uint8_t* HWY_RESTRICT step_exponent = source.step_exponent + begin;
  const float* HWY_RESTRICT basis = source.basis;
  const int16_t* q[kMaxDim];
  for (size_t k = 0; k < source.num_coefficients; ++k) {
    q[k] = source.coefficient[k] + cursor.coefficient[k];
    cursor.coefficient[k] += n;
  }
  size_t i = 0;
  for (; i + kWidth <= n; i += kWidth) {
    const V scale = step_scales(step_exponent + i);
    V row[kDim];
    for (size_t a = 0; a < kDim; ++a) row[a] = hn::Set(d, basis[a]);
    for (size_t k = 0; k < source.num_coefficients; ++k) {
      const float* HWY_RESTRICT vector = basis + kDim * (k + 1);
      const V c = hn::Mul(hn::Mul(load_int16(q[k] + i), scale), hn::Set(d, source.steps[k]));
      for (size_t a = 0; a < kDim; ++a) {
        row[a] = hn::Add(row[a], hn::Mul(c, hn::Set(d, vector[a])));
      }
    }
    if constexpr (kDim == 3) {
      hn::StoreInterleaved3(row[0], row[1], row[2], d, dst + 3 * i);
    } else {
      hn::StoreInterleaved4(row[0], row[1], row[2], row[3], d, dst + 4 * i);
    }
  }
  for (; i < n; ++i) {
    const float scale = step_scale(step_exponent[i]);
    float* row = dst + kDim * i;
    for (size_t a = 0; a < kDim; ++a) row[a] = basis[a];
    for (size_t k = 0; k < source.num_coefficients; ++k) {
      const float c = (static_cast<float>(q[k][i]) * scale) * source.steps[k];
      for (size_t a = 0; a < kDim; ++a) row[a] = row[a] + c * basis[kDim * (k + 1) + a];
    }
  }
}

void rows(const TransformSource& source, TransformCursor& cursor, size_t begin, size_t end,
          float* dst) {
  if (source.eob_index == nullptr && source.dim == 3) {
    return rows_of<3>(source, cursor, begin, end, dst);
  }
  if (source.eob_index == nullptr && source.dim == 4) {
    return rows_of<4>(source, cursor, begin, end, dst);
  }
  // No encoder of this project gives vectors of so few numbers an EOB table.
  transform_kernels_reference().rows(source, cursor, begin, end, dst);
}

HWY_INLINE V on_grid(V w) {
  const V offset = hn::Set(D(), 1.5f);
  return hn::Sub(hn::Add(w, offset), offset);
}

struct HalfVectors {
  V a0, a1, a2, a3;
};

HWY_INLINE HalfVectors half_of_coordinates(V w0, V w1, V w2) {
  const V u0 = on_grid(w0), u1 = on_grid(w1), u2 = on_grid(w2);
  const V one = hn::Set(D(), 1.0f);
  const V norm2 = hn::Add(hn::Add(hn::Mul(u0, u0), hn::Mul(u1, u1)), hn::Mul(u2, u2));
  const V r = hn::Div(hn::Set(D(), 2.0f), hn::Add(one, norm2));
  return {hn::Sub(r, one), hn::Mul(u0, r), hn::Mul(u1, r), hn::Mul(u2, r)};
}

void rotors(const float* spatial, const float* temporal, size_t n, float* dst, bool past_cache) {
  const D d;
  const hn::Full128<float> d4;
  const V half = hn::Set(d, 0.5f);
  const bool stream = can_stream(past_cache, dst);
  HWY_ALIGN float first[4 * kWidth];
  HWY_ALIGN float second[4 * kWidth];
  size_t i = 0;
  for (; i + kWidth <= n; i += kWidth) {
    V u0, u1, u2;
    V v0 = hn::Zero(d), v1 = v0, v2 = v0;
    hn::LoadInterleaved3(d, spatial + 3 * i, u0, u1, u2);
    if (temporal != nullptr) hn::LoadInterleaved3(d, temporal + 3 * i, v0, v1, v2);
    const HalfVectors a = half_of_coordinates(hn::Add(u0, v0), hn::Add(u1, v1), hn::Add(u2, v2));
    const HalfVectors b = half_of_coordinates(hn::Sub(u0, v0), hn::Sub(u1, v1), hn::Sub(u2, v2));
    hn::StoreInterleaved4(hn::Mul(hn::Add(a.a0, b.a0), half), hn::Mul(hn::Add(a.a1, b.a1), half),
                          hn::Mul(hn::Add(a.a2, b.a2), half), hn::Mul(hn::Add(a.a3, b.a3), half), d,
                          first);
    hn::StoreInterleaved4(hn::Mul(hn::Sub(b.a3, a.a3), half), hn::Mul(hn::Sub(a.a2, b.a2), half),
                          hn::Mul(hn::Sub(b.a1, a.a1), half), hn::Mul(hn::Sub(a.a0, b.a0), half), d,
                          second);
    for (size_t j = 0; j < kWidth; ++j) {
      const auto lo = hn::Load(d4, first + 4 * j);
      const auto hi = hn::Load(d4, second + 4 * j);
      float* rotor = dst + 8 * (i + j);
      if (stream) {
        hn::Stream(lo, d4, rotor);
        hn::Stream(hi, d4, rotor + 4);
      } else {
        hn::StoreU(lo, d4, rotor);
        hn::StoreU(hi, d4, rotor + 4);
      }
    }
  }
  if (stream) hwy::FlushStream();
  for (; i < n; ++i) {
    float a[3], b[3];
    for (size_t k = 0; k < 3; ++k) {
      const float u = spatial[3 * i + k];
      const float v = temporal == nullptr ? 0.0f : temporal[3 * i + k];
      a[k] = on_stereographic_grid(u + v);
      b[k] = on_stereographic_grid(u - v);
    }
    RotorHalves<float> halves;
    half_of_stereographic(a, halves.a);
    half_of_stereographic(b, halves.b);
    rotor_of_halves(halves, dst + 8 * i);
  }
}

void positions(const uint32_t* const columns[3], size_t n, const float corner[3], float step,
               float* dst) {
  const D d;
  const hn::RebindToSigned<D> di;
  const V steps = hn::Set(d, step);
  const V corners[3] = {hn::Set(d, corner[0]), hn::Set(d, corner[1]), hn::Set(d, corner[2])};
  size_t i = 0;
  for (; i + kWidth <= n; i += kWidth) {
    V x[3];
    for (size_t axis = 0; axis < 3; ++axis) {
      const auto code = hn::LoadU(hn::RebindToUnsigned<D>(), columns[axis] + i);
      x[axis] = hn::Add(corners[axis], hn::Mul(steps, hn::ConvertTo(d, hn::BitCast(di, code))));
    }
    hn::StoreInterleaved3(x[0], x[1], x[2], d, dst + 3 * i);
  }
  for (; i < n; ++i) {
    for (size_t axis = 0; axis < 3; ++axis) {
      const int32_t code = static_cast<int32_t>(columns[axis][i]);
      dst[3 * i + axis] = corner[axis] + step * static_cast<float>(code);
    }
  }
}

const TransformKernels* kernels() {
  static constexpr TransformKernels kKernels = {rows, integer_rows, rotors, positions};
  return &kKernels;
}
#endif  // HWY_TARGET == HWY_SCALAR || HWY_HAVE_SCALABLE

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace l4d
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace l4d {
HWY_EXPORT(kernels);
const TransformKernels& transform_kernels_simd() { return *HWY_DYNAMIC_DISPATCH(kernels)(); }
}  // namespace l4d
#endif
