// SPDX-License-Identifier: Apache-2.0
// The squared distance of two vectors of more than NearestIndex::kMaxPlainDim numbers, once per
// SIMD target.
#if defined(L4D_ENCODER_ROW_DISTANCE_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef L4D_ENCODER_ROW_DISTANCE_INL
#undef L4D_ENCODER_ROW_DISTANCE_INL
#else
#define L4D_ENCODER_ROW_DISTANCE_INL
#endif

#include <hwy/highway.h>

#include <cstddef>

HWY_BEFORE_NAMESPACE();
namespace l4d {
namespace HWY_NAMESPACE {
namespace {
namespace hn = hwy::HWY_NAMESPACE;

using D = hn::CappedTag<float, 8>;
using V = hn::Vec<D>;

// The sum of the partial sums in an order of our own: a device repeats it.
HWY_INLINE float sum_of_lanes(V v) {
  const D d;
  HWY_ALIGN float lane[8] = {};
  hn::Store(v, d, lane);
  return ((lane[0] + lane[4]) + (lane[2] + lane[6])) + ((lane[1] + lane[5]) + (lane[3] + lane[7]));
}

// In the one order of operations all searches use.
HWY_INLINE float row_distance(const float* HWY_RESTRICT a, const float* HWY_RESTRICT b,
                              size_t dim) {
  const D d;
  const size_t lanes = hn::Lanes(d);
  V sum = hn::Zero(d);
  size_t j = 0;
  for (; j + lanes <= dim; j += lanes) {
    const V e = hn::Sub(hn::LoadU(d, a + j), hn::LoadU(d, b + j));
    sum = hn::MulAdd(e, e, sum);
  }
  float rest = 0;
  for (; j < dim; ++j) rest += (a[j] - b[j]) * (a[j] - b[j]);
  return sum_of_lanes(sum) + rest;
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace l4d
HWY_AFTER_NAMESPACE();

#endif  // L4D_ENCODER_ROW_DISTANCE_INL
