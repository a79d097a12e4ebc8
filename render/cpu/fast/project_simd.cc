// SPDX-License-Identifier: Apache-2.0
// Projection and shading of the fast path, a vector of Gaussians at a time.
#include "render/cpu/fast/project_simd.h"

#include <cmath>

#include "libl4dcodec/scene/sh.h"
#include "render/cpu/fast/kernels.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "render/cpu/fast/project_simd.cc"
#include <hwy/foreach_target.h>
#include <hwy/contrib/math/math-inl.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace l4d::render {
namespace HWY_NAMESPACE {
namespace {
namespace hn = hwy::HWY_NAMESPACE;

using D = hn::CappedTag<float, 16>;
using V = hn::Vec<D>;
constexpr size_t kMaxLanes = 16;

// Basis functions of a vector of directions: basis[k] for all lanes.
template <uint32_t kDegree>
HWY_INLINE void basis_of(D d, V x, V y, V z, float* HWY_RESTRICT basis /* [terms, kMaxLanes] */) {
  using namespace sh_constant;
  const auto c = [&](double v) HWY_ATTR { return hn::Set(d, static_cast<float>(v)); };
  const auto put = [&](size_t k, V v) HWY_ATTR { hn::Store(v, d, basis + kMaxLanes * k); };
  put(0, c(k0));
  if (kDegree < 1) return;
  put(1, hn::Mul(c(-k1), y));
  put(2, hn::Mul(c(k1), z));
  put(3, hn::Mul(c(-k1), x));
  if (kDegree < 2) return;
  const V xx = hn::Mul(x, x), yy = hn::Mul(y, y), zz = hn::Mul(z, z);
  const V xy = hn::Mul(x, y);
  const V sum = hn::Add(xx, yy), difference = hn::Sub(xx, yy);
  put(4, hn::Mul(c(k2[0]), xy));
  put(5, hn::Mul(c(k2[1]), hn::Mul(y, z)));
  put(6, hn::Mul(c(k2[2]), hn::Sub(hn::Add(zz, zz), sum)));
  put(7, hn::Mul(c(k2[3]), hn::Mul(x, z)));
  put(8, hn::Mul(c(k2[4]), difference));
  if (kDegree < 3) return;
  const V high = hn::MulSub(c(4), zz, sum);  // 4 zz - xx - yy
  put(9, hn::Mul(hn::Mul(c(k3[0]), y), hn::MulSub(c(3), xx, yy)));
  put(10, hn::Mul(hn::Mul(c(k3[1]), xy), z));
  put(11, hn::Mul(hn::Mul(c(k3[2]), y), high));
  put(12, hn::Mul(hn::Mul(c(k3[3]), z), hn::NegMulAdd(c(3), sum, hn::Add(zz, zz))));
  put(13, hn::Mul(hn::Mul(c(k3[4]), x), high));
  put(14, hn::Mul(hn::Mul(c(k3[5]), z), difference));
  put(15, hn::Mul(hn::Mul(c(k3[6]), x), hn::NegMulAdd(c(3), yy, xx)));
}

// 0.5 + the sum over terms, in lanes 0 to 2. Four floats are loaded where three are wanted; the
// last term is taken one float earlier, so that nothing beyond the row is read.
template <uint32_t kDegree>
HWY_INLINE void color_of(const float* HWY_RESTRICT sh, const float* HWY_RESTRICT basis,
                         float* color) {
  constexpr size_t kTerms = sh_terms(kDegree);
  if (kDegree == 0) {
    for (size_t c = 0; c < 3; ++c) color[c] = 0.5f + basis[0] * sh[c];
    return;
  }
#if HWY_TARGET == HWY_SCALAR
  for (size_t c = 0; c < 3; ++c) {
    float sum = 0.5f;
    for (size_t k = 0; k < kTerms; ++k) sum += basis[kMaxLanes * k] * sh[3 * k + c];
    color[c] = sum;
  }
#else
  const hn::Full128<float> d4;
  // Two chains, so that one addition need not wait for the one before.
  auto even = hn::Mul(hn::Set(d4, basis[0]), hn::LoadU(d4, sh));
  auto odd = hn::Set(d4, 0.5f);
  for (size_t k = 1; k + 1 < kTerms; k += 2) {
    odd = hn::MulAdd(hn::Set(d4, basis[kMaxLanes * k]), hn::LoadU(d4, sh + 3 * k), odd);
    if (k + 2 < kTerms) {
      even = hn::MulAdd(hn::Set(d4, basis[kMaxLanes * (k + 1)]), hn::LoadU(d4, sh + 3 * (k + 1)),
                        even);
    }
  }
  alignas(16) float sum[4];
  hn::Store(hn::Add(even, odd), d4, sum);
  const size_t last = kTerms - 1;
  for (size_t c = 0; c < 3; ++c) color[c] = sum[c] + basis[kMaxLanes * last] * sh[3 * last + c];
#endif
}

struct Lanes {
  alignas(64) float mean[2][kMaxLanes];
  alignas(64) float conic[3][kMaxLanes];
  alignas(64) float log2_opacity[kMaxLanes];
  alignas(64) float log2_least[kMaxLanes];
  alignas(64) float factor[kMaxLanes];  // of the opacity
  alignas(64) float extent[2][kMaxLanes];
  alignas(64) float depth[kMaxLanes];
  alignas(64) float basis[kMaxShTerms * kMaxLanes];
};

template <uint32_t kDegree>
size_t project_rows(const Frame<float>& frame, const View<float>& view, size_t begin, size_t end,
                    FastSplat* out) {
  const D d;
  const size_t lanes = hn::Lanes(d);
  Lanes s;
  size_t written = 0;
  const auto set = [&](float v) HWY_ATTR { return hn::Set(d, v); };
  const V zero = hn::Zero(d), one = set(1), half = set(0.5f);
  const V right = set(static_cast<float>(view.width) - 0.5f);
  const V bottom = set(static_cast<float>(view.height) - 0.5f);
  const float log2_min_alpha = view.rules.min_alpha == static_cast<float>(kMinAlpha)
                                   ? kLog2MinAlpha
                                   : std::log2(view.rules.min_alpha);
  const float* r = view.rotation;
  const float focal[2] = {view.fx, view.fy};
  for (size_t i = begin; i < end; i += lanes) {
    const size_t left = end - i;
    const auto present = hn::FirstN(d, left);
    const auto load = [&](const std::vector<float>& column) HWY_ATTR {
      return hn::LoadU(d, column.data() + i);  // a frame is padded
    };
    const V x = load(frame.position[0]), y = load(frame.position[1]), z = load(frame.position[2]);
    const V opacity = load(frame.opacity);
    V camera[3];
    for (size_t k = 0; k < 3; ++k) {
      camera[k] =
          hn::MulAdd(set(r[3 * k]), x,
                     hn::MulAdd(set(r[3 * k + 1]), y,
                                hn::MulAdd(set(r[3 * k + 2]), z, set(view.translation[k]))));
    }
    auto in_view = hn::And(present, hn::And(hn::Gt(camera[2], set(view.near_plane)),
                                            hn::Ge(opacity, set(view.rules.min_alpha))));
    if (hn::AllFalse(d, in_view)) continue;
    const V inverse_z = hn::Div(one, hn::IfThenElse(in_view, camera[2], one));
    V mean[2], jw[2][3];
    const float origin[2] = {view.cx, view.cy};
    for (size_t k = 0; k < 2; ++k) {
      const V slope = hn::Mul(camera[k], inverse_z);
      mean[k] = hn::MulAdd(set(focal[k]), slope, set(origin[k]));
      const V taken = hn::Min(hn::Max(slope, set(view.min_slope[k])), set(view.max_slope[k]));
      const V scale = hn::Mul(set(focal[k]), inverse_z);
      for (size_t c = 0; c < 3; ++c) {
        jw[k][c] = hn::Mul(scale, hn::NegMulAdd(taken, set(r[6 + c]), set(r[3 * k + c])));
      }
    }
    V sigma[6];
    for (size_t k = 0; k < 6; ++k) sigma[k] = load(frame.covariance[k]);
    const auto row = [&](const V* j, V* t) HWY_ATTR {  // j Sigma
      t[0] = hn::MulAdd(j[0], sigma[0], hn::MulAdd(j[1], sigma[1], hn::Mul(j[2], sigma[2])));
      t[1] = hn::MulAdd(j[0], sigma[1], hn::MulAdd(j[1], sigma[3], hn::Mul(j[2], sigma[4])));
      t[2] = hn::MulAdd(j[0], sigma[2], hn::MulAdd(j[1], sigma[4], hn::Mul(j[2], sigma[5])));
    };
    V t0[3], t1[3];
    row(jw[0], t0);
    row(jw[1], t1);
    const auto dot = [](const V* a, const V* b) HWY_ATTR {
      return hn::MulAdd(a[0], b[0], hn::MulAdd(a[1], b[1], hn::Mul(a[2], b[2])));
    };
    const V dilation = set(view.rules.dilation);
    const V bare_xx = dot(t0, jw[0]), bare_yy = dot(t1, jw[1]);
    const V xx = hn::Add(bare_xx, dilation);
    const V xy = dot(t0, jw[1]);
    const V yy = hn::Add(bare_yy, dilation);
    // The product of two entries must not overflow where a Gaussian is huge; a power of two rounds
    // nothing.
    const V widest = hn::Max(xx, yy);
    const V shrink = hn::IfThenElse(hn::Gt(widest, set(0x1p60f)), set(0x1p-64f), one);
    const V small_xx = hn::Mul(xx, shrink), small_yy = hn::Mul(yy, shrink);
    const V small_xy = hn::Mul(xy, shrink);
    const V det = hn::MulSub(small_xx, small_yy, hn::Mul(small_xy, small_xy));
    in_view = hn::And(in_view, hn::And(hn::Gt(det, zero), hn::IsFinite(widest)));
    V factor = one;
    if (view.rules.compensates) {
      const V bare = hn::MulSub(hn::Mul(bare_xx, shrink), hn::Mul(bare_yy, shrink),
                                hn::Mul(small_xy, small_xy));
      factor = hn::Sqrt(hn::Div(hn::Max(bare, zero), hn::IfThenElse(in_view, det, one)));
      in_view = hn::And(in_view, hn::Ge(hn::Mul(opacity, factor), set(view.rules.min_alpha)));
    }
    const V log2_opacity = hn::Log2(d, hn::IfThenElse(in_view, hn::Mul(opacity, factor), one));
    // reach = 2 ln(opacity / min_alpha), or the cut-off
    constexpr float kTwoLn2 = 1.38629436f;
    const V reach =
        hn::Min(hn::Max(zero, hn::Mul(set(kTwoLn2), hn::Sub(log2_opacity, set(log2_min_alpha)))),
                set(view.rules.max_reach));
    const V log2_least =
        hn::Max(set(log2_min_alpha), hn::Sub(log2_opacity, set(view.rules.max_reach / kTwoLn2)));
    const V extent_x = hn::Sqrt(hn::Mul(reach, xx)), extent_y = hn::Sqrt(hn::Mul(reach, yy));
    in_view = hn::And(in_view, hn::And(hn::Ge(hn::Add(mean[0], extent_x), half),
                                       hn::Le(hn::Sub(mean[0], extent_x), right)));
    in_view = hn::And(in_view, hn::And(hn::Ge(hn::Add(mean[1], extent_y), half),
                                       hn::Le(hn::Sub(mean[1], extent_y), bottom)));
    if (hn::AllFalse(d, in_view)) continue;

    constexpr float kHalfLog2E = 0.72134752f;
    const V scale = hn::Mul(hn::Div(set(-kHalfLog2E), hn::IfThenElse(in_view, det, one)), shrink);
    hn::Store(mean[0], d, s.mean[0]);
    hn::Store(mean[1], d, s.mean[1]);
    hn::Store(hn::Mul(scale, small_yy), d, s.conic[0]);
    hn::Store(hn::Mul(hn::Mul(set(-2), scale), small_xy), d, s.conic[1]);
    hn::Store(hn::Mul(scale, small_xx), d, s.conic[2]);
    hn::Store(log2_opacity, d, s.log2_opacity);
    hn::Store(log2_least, d, s.log2_least);
    hn::Store(factor, d, s.factor);
    hn::Store(extent_x, d, s.extent[0]);
    hn::Store(extent_y, d, s.extent[1]);
    hn::Store(camera[2], d, s.depth);
    if (kDegree > 0) {
      const V dx = hn::Sub(x, set(view.center[0]));
      const V dy = hn::Sub(y, set(view.center[1]));
      const V dz = hn::Sub(z, set(view.center[2]));
      const V norm = hn::Sqrt(hn::MulAdd(dx, dx, hn::MulAdd(dy, dy, hn::Mul(dz, dz))));
      // Nothing in view has norm 0: its depth is beyond the near plane.
      const V inverse = hn::Div(one, hn::IfThenElse(in_view, norm, one));
      basis_of<kDegree>(d, hn::Mul(dx, inverse), hn::Mul(dy, inverse), hn::Mul(dz, inverse),
                        s.basis);
    } else {
      basis_of<0>(d, zero, zero, zero, s.basis);
    }
    uint8_t bits[8] = {};
    hn::StoreMaskBits(d, in_view, bits);
    uint32_t set_lanes = bits[0] | (lanes > 8 ? uint32_t{bits[1]} << 8 : 0);
    for (; set_lanes != 0; set_lanes &= set_lanes - 1) {
      const size_t lane = static_cast<size_t>(hwy::Num0BitsBelowLS1Bit_Nonzero32(set_lanes));
      FastSplat& splat = out[written++];
      for (size_t k = 0; k < 2; ++k) splat.mean[k] = s.mean[k][lane];
      for (size_t k = 0; k < 3; ++k) splat.conic[k] = s.conic[k][lane];
      splat.log2_opacity = s.log2_opacity[lane];
      splat.log2_least = s.log2_least[lane];
      for (size_t k = 0; k < 2; ++k) splat.extent[k] = s.extent[k][lane];
      splat.depth = s.depth[lane];
      splat.row = static_cast<uint32_t>(i + lane);
      splat.opacity = frame.opacity[i + lane] * s.factor[lane];
      float color[3];
      color_of<kDegree>(frame.sh[i + lane], s.basis + lane, color);
      splat.clamped = 0;
      for (uint32_t c = 0; c < 3; ++c) {
        splat.clamped |= color[c] < 0 ? 1u << c : 0;
        splat.color[c] = color[c] < 0 ? 0 : color[c];
      }
    }
  }
  return written;
}

size_t project(const Frame<float>& frame, const View<float>& view, size_t begin, size_t end,
               FastSplat* out) {
  switch (frame.sh_degree) {
    case 0:
      return project_rows<0>(frame, view, begin, end, out);
    case 1:
      return project_rows<1>(frame, view, begin, end, out);
    case 2:
      return project_rows<2>(frame, view, begin, end, out);
    default:
      return project_rows<3>(frame, view, begin, end, out);
  }
}

ProjectKernel kernel() { return project; }

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace l4d::render
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace l4d::render {
HWY_EXPORT(kernel);
ProjectKernel project_kernel() { return HWY_DYNAMIC_DISPATCH(kernel)(); }
}  // namespace l4d::render
#endif
