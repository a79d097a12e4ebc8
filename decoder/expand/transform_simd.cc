// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstring>

#include "decoder/expand/transform.h"
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

// Gaussians that are worked on together, with whole vectors for each row. Bit i of a mask is
// Gaussian i. Before the first element of `scale` and `c` there is room for the rest of a vector
// that ends with it, and behind the last of `scale` for one that begins with it.
struct Batch {
  static constexpr size_t kSize = 64;
  static constexpr size_t kPitch = kWidth + kSize;
  HWY_ALIGN float rows[kSize * kMaxDim];
  HWY_ALIGN float basis[(kMaxDim + 1) * kMaxDim];
  HWY_ALIGN float step_scale[kSize];
  HWY_ALIGN float scale[kPitch + kWidth];  // of those that reach the step of the EOB table at hand
  HWY_ALIGN float c[kMaxDim][kPitch];      // of those that reach coefficient k, in order
  uint64_t reach[kMaxDim];                 // who reaches step s
  uint8_t step_exponent[kSize];
  uint8_t eob_index[kSize];
};

// The first n coefficients of a channel, times scale and step.
HWY_INLINE void scale_channel(const int16_t* HWY_RESTRICT q, size_t before, size_t n, float step,
                              const float* HWY_RESTRICT scale, float* HWY_RESTRICT c) {
  const D d;
  const V steps = hn::Set(d, step);
  const auto vector_at = [&](std::ptrdiff_t j) HWY_ATTR {
    hn::StoreU(hn::Mul(hn::Mul(load_int16(q + j), hn::LoadU(d, scale + j)), steps), d, c + j);
  };
  size_t j = 0;
  for (; j + kWidth <= n; j += kWidth) vector_at(static_cast<std::ptrdiff_t>(j));
  if (j == n) return;
  if (before + n >= kWidth) {
    // The last whole vector, part of which is done already, or of the batch before.
    vector_at(static_cast<std::ptrdiff_t>(n) - static_cast<std::ptrdiff_t>(kWidth));
    return;
  }
  for (; j < n; ++j) c[j] = (static_cast<float>(q[j]) * scale[j]) * step;
}

// How many sums fit in the registers, besides factors.
#if HWY_TARGET <= HWY_AVX3 || HWY_ARCH_ARM_A64
constexpr size_t kMaxVectors = 3;
#else
constexpr size_t kMaxVectors = 2;
#endif

// kVectors vectors, from `column` on, of the rows of kGroup Gaussians that have all coefficients of
// the first `steps` steps. Several at a time share the loads of the basis.
template <size_t kGroup, size_t kVectors>
HWY_INLINE void sum_columns(const uint8_t* HWY_RESTRICT eob_table, size_t steps,
                            const size_t (&gaussian)[kGroup], size_t column, size_t stride,
                            Batch& batch) {
  const D d;
  const float* HWY_RESTRICT vector = batch.basis + column;
  V row[kGroup][kVectors];
  for (size_t v = 0; v < kVectors; ++v) {
    for (size_t g = 0; g < kGroup; ++g) row[g][v] = hn::Load(d, vector + v * kWidth);
  }
  const float* HWY_RESTRICT channel = batch.c[0] + kWidth;
  for (size_t s = 0, k = 0; s < steps; ++s) {
    const float* c[kGroup];
    for (size_t g = 0; g < kGroup; ++g) {
      const uint64_t before = batch.reach[s] & ((uint64_t{1} << gaussian[g]) - 1);
      c[g] = channel + hwy::PopCount(before);
    }
    const size_t count = eob_table[s] - k;
    k = eob_table[s];
    channel += Batch::kPitch * count;
    for (size_t at = 0; at < Batch::kPitch * count; at += Batch::kPitch) {
      vector += stride;
      V a[kGroup];
      for (size_t g = 0; g < kGroup; ++g) a[g] = hn::Set(d, c[g][at]);
      for (size_t v = 0; v < kVectors; ++v) {
        const V b = hn::Load(d, vector + v * kWidth);
        for (size_t g = 0; g < kGroup; ++g) row[g][v] = hn::Add(row[g][v], hn::Mul(a[g], b));
      }
    }
  }
  for (size_t g = 0; g < kGroup; ++g) {
    float* HWY_RESTRICT dst = batch.rows + stride * gaussian[g] + column;
    for (size_t v = 0; v < kVectors; ++v) hn::Store(row[g][v], d, dst + v * kWidth);
  }
}

// Takes kGroup Gaussians from `members`; where there are fewer, one is done several times.
template <size_t kGroup>
HWY_INLINE uint64_t sum_group(const uint8_t* eob_table, size_t steps, uint64_t members,
                              size_t stride, Batch& batch) {
  size_t gaussian[kGroup];
  size_t last = 0;
  for (size_t g = 0; g < kGroup; ++g) {
    if (members != 0) last = hwy::Num0BitsBelowLS1Bit_Nonzero64(members);
    gaussian[g] = last;
    members &= members - 1;
  }
  size_t column = 0;
  for (; column + kMaxVectors * kWidth <= stride; column += kMaxVectors * kWidth) {
    sum_columns<kGroup, kMaxVectors>(eob_table, steps, gaussian, column, stride, batch);
  }
  const size_t left = (stride - column) / kWidth;
  if (left == 1) sum_columns<kGroup, 1>(eob_table, steps, gaussian, column, stride, batch);
  if (left == 2) sum_columns<kGroup, 2>(eob_table, steps, gaussian, column, stride, batch);
  return members;
}

// The rows of the Gaussians of one EOB index.
HWY_NOINLINE void sum_rows(const uint8_t* eob_table, size_t steps, uint64_t members, size_t stride,
                           Batch& batch) {
  size_t n = hwy::PopCount(members);
  for (; n > 2; n -= std::min<size_t>(n, 4)) {
    members = sum_group<4>(eob_table, steps, members, stride, batch);
  }
  if (n > 0) sum_group<2>(eob_table, steps, members, stride, batch);
}

// Who has an EOB index above `step`. Both are small enough for signed comparisons.
HWY_INLINE uint64_t eob_indices_above(const uint8_t* HWY_RESTRICT eob_index, size_t step) {
  const hn::CappedTag<int8_t, Batch::kSize> d8;
  const auto steps = hn::Set(d8, static_cast<int8_t>(step));
  uint64_t mask = 0;
  for (size_t i = 0; i < Batch::kSize; i += hn::Lanes(d8)) {
    uint8_t bits[8] = {};
    const auto eob_indices = hn::LoadU(d8, reinterpret_cast<const int8_t*>(eob_index + i));
    hn::StoreMaskBits(d8, hn::Gt(eob_indices, steps), bits);
    uint64_t part;
    std::memcpy(&part, bits, sizeof(part));
    mask |= part << i;
  }
  return mask;
}

// Leaves the scales of `members`, whose EOB index is above `step`.
HWY_INLINE void compress_scales(const Batch& batch, uint64_t members, size_t step,
                                float* HWY_RESTRICT to) {
#if HWY_TARGET <= HWY_AVX3
  (void)members;
  const D d;
  const hn::RebindToSigned<D> di;
  const hn::Rebind<uint8_t, D> d8;
  const auto steps = hn::Set(di, static_cast<int32_t>(step));
  for (size_t i = 0; i < Batch::kSize; i += kWidth) {
    const auto eob_indices = hn::PromoteTo(di, hn::LoadU(d8, batch.eob_index + i));
    const auto above = hn::RebindMask(d, hn::Gt(eob_indices, steps));
    hn::StoreU(hn::Compress(hn::Load(d, batch.step_scale + i), above), d, to);
    to += hn::CountTrue(d, above);
  }
#else
  // Without an instruction for it, Compress of Highway 1.0 copies its table at each call (gcc).
  (void)step;
  for (; members != 0; members &= members - 1) {
    *to++ = batch.step_scale[hwy::Num0BitsBelowLS1Bit_Nonzero64(members)];
  }
#endif
}

// Fills the first n rows of a batch from its step_exponents and EOB indices. Step by step of the
// EOB table: who goes no further is summed up, the others get the coefficients of the step.
HWY_NOINLINE void sum_batch(const TransformSource& source, TransformCursor& cursor,
                            const uint8_t* eob_table, size_t n, size_t stride, Batch& batch) {
  const D d;
  for (size_t i = 0; i < Batch::kSize; i += kWidth) {
    hn::Store(step_scales(batch.step_exponent + i), d, batch.step_scale + i);
  }
  uint64_t members = ~uint64_t{0} >> (Batch::kSize - n);
  size_t s = 0;
  for (size_t k = 0; k < source.num_coefficients && members != 0; ++s) {
    const uint64_t reach = members & eob_indices_above(batch.eob_index, s);
    batch.reach[s] = reach;
    sum_rows(eob_table, s, members ^ reach, stride, batch);
    members = reach;
    compress_scales(batch, members, s, batch.scale + kWidth);
    const size_t count = hwy::PopCount(members);
    for (; k < eob_table[s]; ++k) {
      size_t& at = cursor.coefficient[k];
      scale_channel(source.coefficient[k] + at, at, count, source.steps[k], batch.scale + kWidth,
                    batch.c[k] + kWidth);
      at += count;
    }
  }
  sum_rows(eob_table, s, members, stride, batch);
}

void rows_by_eob_index(const TransformSource& source, TransformCursor& cursor, size_t begin,
                       size_t end, float* dst, bool past_cache) {
  const D d;
  const size_t dim = source.dim;
  const size_t stride = hwy::RoundUpTo(dim, kWidth);
  const bool stream = can_stream(past_cache, dst);
  // Without an EOB table there is one step, which all reach.
  const uint8_t all = static_cast<uint8_t>(source.num_coefficients);
  const uint8_t* eob_table = source.eob_index == nullptr ? &all : source.eob_table;
  Batch batch;
  std::fill_n(batch.scale, kWidth, 0.0f);
  std::fill_n(batch.step_exponent, Batch::kSize, uint8_t{0});
  std::fill_n(batch.eob_index, Batch::kSize, uint8_t{1});
  for (size_t k = 0; k <= source.num_coefficients; ++k) {
    for (size_t v = 0; v < stride; v += kWidth) {
      hn::Store(hn::LoadU(d, source.basis + dim * k + v), d, batch.basis + stride * k + v);
    }
  }
  for (size_t i = begin; i < end; i += Batch::kSize) {
    const size_t n = std::min(Batch::kSize, end - i);
    std::copy_n(source.step_exponent + i, n, batch.step_exponent);
    if (source.eob_index != nullptr) std::copy_n(source.eob_index + i, n, batch.eob_index);
    sum_batch(source, cursor, eob_table, n, stride, batch);
    for (size_t j = 1; j < n && stride != dim; ++j) {
      for (size_t v = 0; v < stride; v += kWidth) {
        hn::StoreU(hn::LoadU(d, batch.rows + j * stride + v), d, batch.rows + j * dim + v);
      }
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
          float* dst, bool past_cache) {
  if (source.eob_index == nullptr && source.dim == 3) {
    return rows_of<3>(source, cursor, begin, end, dst);
  }
  if (source.eob_index == nullptr && source.dim == 4) {
    return rows_of<4>(source, cursor, begin, end, dst);
  }
  rows_by_eob_index(source, cursor, begin, end, dst, past_cache);
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
  const V divisor = hn::Add(one, norm2);
  return {hn::Div(hn::Sub(one, norm2), divisor), hn::Div(hn::Add(u0, u0), divisor),
          hn::Div(hn::Add(u1, u1), divisor), hn::Div(hn::Add(u2, u2), divisor)};
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
  static constexpr TransformKernels kKernels = {rows, rotors, positions};
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
