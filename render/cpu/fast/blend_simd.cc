// SPDX-License-Identifier: Apache-2.0
// Blending of one tile, forward and backward, a row of pixels at a time.
#include "render/cpu/fast/blend_simd.h"

#include <algorithm>
#include <cmath>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "render/cpu/fast/blend_simd.cc"
#include <hwy/foreach_target.h>
#include <hwy/cache_control.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace l4d::render {
namespace HWY_NAMESPACE {
namespace {
namespace hn = hwy::HWY_NAMESPACE;

using D = hn::CappedTag<float, kTile>;
using V = hn::Vec<D>;
constexpr size_t kPrefetch = 8;  // splats ahead
constexpr float kStop = static_cast<float>(kMinTransmittance);

// 2^x for x in [-8, 0]: the exponent's bits, times a polynomial of the rest in [-1/2, 1/2].
template <bool kFast>
HWY_INLINE V exp2_of(D d, V x) {
  const auto c = [&](float v) HWY_ATTR { return hn::Set(d, v); };
  const V whole = hn::Round(x);
  const V f = hn::Sub(x, whole);
  V p;
  if (kFast) {  // relative error 7.5e-5
    p = hn::MulAdd(f, c(0.0551716685f), c(0.24261114f));
    p = hn::MulAdd(f, p, c(0.693260968f));
    p = hn::MulAdd(f, p, c(0.999928057f));
  } else {  // relative error 7.5e-8 before rounding
    p = hn::MulAdd(f, c(0.00132764725f), c(0.00967554189f));
    p = hn::MulAdd(f, p, c(0.0555071309f));
    p = hn::MulAdd(f, p, c(0.240221202f));
    p = hn::MulAdd(f, p, c(0.693146944f));
    p = hn::MulAdd(f, p, c(1.00000012f));
  }
  const hn::RebindToSigned<D> di;
  const auto exponent = hn::ShiftLeft<23>(hn::ConvertTo(di, whole));
  return hn::BitCast(d, hn::Add(hn::BitCast(di, p), exponent));
}

struct Rows {
  int begin, end;
};
// Rows of the tile that the splat's box reaches.
HWY_INLINE Rows rows_of(const TileInput& tile, const FastSplat& s) {
  const float top = s.mean[1] - s.extent[1] - 0.5f - static_cast<float>(tile.y);
  const float bottom = s.mean[1] + s.extent[1] - 0.5f - static_cast<float>(tile.y);
  // Clamped while still floating: far outside, the integers would overflow.
  const float limit = static_cast<float>(tile.height);
  const int begin = static_cast<int>(std::ceil(std::min(std::max(top, 0.0f), limit)));
  const int end = static_cast<int>(std::floor(std::min(std::max(bottom, -1.0f), limit - 1))) + 1;
  return {begin, end};
}

// Pixels begin with transmittance 1; those of the last columns that are outside the image with 0.
HWY_INLINE void start(D d, const TileInput& tile, float* HWY_RESTRICT transmittance) {
  const V width = hn::Set(d, static_cast<float>(tile.width));
  for (int y = 0; y < kTile; ++y) {
    for (int x = 0; x < kTile; x += static_cast<int>(hn::Lanes(d))) {
      const V column = hn::Iota(d, static_cast<float>(x));
      const V one = hn::Set(d, y < tile.height ? 1.0f : 0.0f);
      hn::Store(hn::IfThenElseZero(hn::Lt(column, width), one), d, transmittance + kTile * y + x);
    }
  }
}

// Walks the list front to back. For every vector of pixels that a splat reaches, calls
//   body(n, pixel, dx, dy, alpha, before, stopped)
// with n the place in the list, dx, dy offsets from the mean, alpha zero where the splat does not
// show, and the transmittance before; pixels that stop here or have stopped are in `stopped`,
// and the splat does not count for them. transmittance [kTilePixels] ends as what shines through.
template <bool kFastExp, class Body>
HWY_INLINE void walk(const TileInput& tile, float* HWY_RESTRICT transmittance, const Body& body) {
  const D d;
  constexpr size_t kStride = kTile;
  const size_t lanes = hn::Lanes(d);
  alignas(64) float final_t[kTilePixels];
  start(d, tile, transmittance);
  std::fill_n(final_t, kTilePixels, -1.0f);
  const V most_alpha = hn::Set(d, tile.max_alpha);
  uint32_t rows_alive = (1u << tile.height) - 1;
  for (size_t n = 0; n < tile.count && rows_alive != 0; ++n) {
    hwy::Prefetch(tile.splats + tile.list[std::min(n + kPrefetch, tile.count - 1)]);
    const FastSplat& s = tile.splats[tile.list[n]];
    const Rows rows = rows_of(tile, s);
    const float left = static_cast<float>(tile.x) + 0.5f - s.mean[0];
    const V least = hn::Set(d, s.log2_least);
    for (int y = rows.begin; y < rows.end; ++y) {
      if ((rows_alive >> y & 1) == 0) continue;
      const float dy = static_cast<float>(tile.y + y) + 0.5f - s.mean[1];
      const V base = hn::Set(d, s.log2_opacity + s.conic[2] * dy * dy);
      const V linear = hn::Set(d, s.conic[1] * dy);
      const V square = hn::Set(d, s.conic[0]);
      bool stopped_any = false;
      for (size_t x = 0; x < kStride; x += lanes) {
        const V dx = hn::Add(hn::Set(d, left), hn::Iota(d, static_cast<float>(x)));
        const V log2_alpha = hn::MulAdd(dx, hn::MulAdd(square, dx, linear), base);
        const auto reached = hn::Ge(log2_alpha, least);
        if (hn::AllFalse(d, reached)) continue;
        const size_t pixel = kStride * static_cast<size_t>(y) + x;
        const V before = hn::Load(d, transmittance + pixel);
        const V alpha =
            hn::IfThenElseZero(reached, hn::Min(exp2_of<kFastExp>(d, log2_alpha), most_alpha));
        const V after = hn::NegMulAdd(before, alpha, before);
        // Also true of pixels that stopped earlier, whose transmittance is kept as 0 here.
        const auto stopped = hn::Lt(after, hn::Set(d, kStop));
        body(n, pixel, dx, dy, alpha, before, stopped);
        hn::Store(hn::IfThenZeroElse(stopped, after), d, transmittance + pixel);
        if (!hn::AllFalse(d, stopped)) {
          const auto now = hn::And(stopped, hn::Gt(before, hn::Zero(d)));
          hn::Store(hn::IfThenElse(now, before, hn::Load(d, final_t + pixel)), d, final_t + pixel);
          stopped_any = true;
        }
      }
      if (stopped_any) {
        V most = hn::Zero(d);
        for (size_t x = 0; x < kStride; x += lanes) {
          most = hn::Max(most, hn::Load(d, transmittance + kStride * static_cast<size_t>(y) + x));
        }
        if (hn::AllTrue(d, hn::Eq(most, hn::Zero(d)))) rows_alive &= ~(1u << y);
      }
    }
  }
  for (size_t p = 0; p < kTilePixels; p += lanes) {
    const V kept = hn::Load(d, final_t + p);
    const auto has_stopped = hn::Ge(kept, hn::Zero(d));
    hn::Store(hn::IfThenElse(has_stopped, kept, hn::Load(d, transmittance + p)), d,
              transmittance + p);
  }
}

template <bool kFastExp>
HWY_INLINE void blend_with(const TileInput& tile, TileImage* out) {
  const D d;
  for (auto& plane : out->rgb) std::fill_n(plane, kTilePixels, 0.0f);
  walk<kFastExp>(tile, out->transmittance,
                 [&](size_t n, size_t pixel, V, float, V alpha, V before, auto stopped) HWY_ATTR {
                   const FastSplat& s = tile.splats[tile.list[n]];
                   const V weight = hn::IfThenZeroElse(stopped, hn::Mul(before, alpha));
                   for (size_t c = 0; c < 3; ++c) {
                     float* plane = out->rgb[c] + pixel;
                     hn::Store(hn::MulAdd(weight, hn::Set(d, s.color[c]), hn::Load(d, plane)), d,
                               plane);
                   }
                 });
}

void blend(const TileInput& tile, TileImage* out) { blend_with<false>(tile, out); }
void blend_fast_exp(const TileInput& tile, TileImage* out) { blend_with<true>(tile, out); }

void coverage(const TileInput& tile, float* out) {
  const D d;
  std::fill_n(out, tile.count, 0.0f);
  alignas(64) float transmittance[kTilePixels];
  V sum = hn::Zero(d);
  size_t current = ~size_t{0};
  const auto finish = [&]() HWY_ATTR {
    if (current != ~size_t{0}) out[current] = hn::GetLane(hn::SumOfLanes(d, sum));
  };
  walk<false>(tile, transmittance,
              [&](size_t n, size_t, V, float, V alpha, V before, auto stopped) HWY_ATTR {
                if (n != current) {
                  finish();
                  sum = hn::Zero(d);
                  current = n;
                }
                sum = hn::Add(sum, hn::IfThenZeroElse(stopped, hn::Mul(before, alpha)));
              });
  finish();
}

// Sums over the lanes of four vectors at once: a third of the work of one at a time.
HWY_INLINE void sum_four(D d, V a, V b, V c, V e, float* HWY_RESTRICT out /* [4] */) {
#if HWY_TARGET == HWY_SCALAR
  const V parts[4] = {a, b, c, e};
  for (int k = 0; k < 4; ++k) out[k] = hn::GetLane(hn::SumOfLanes(d, parts[k]));
#else
  // Within each block of four lanes: a02 b02 a13 b13, likewise c e, then a b c e.
  const V ab = hn::Add(hn::InterleaveLower(d, a, b), hn::InterleaveUpper(d, a, b));
  const V ce = hn::Add(hn::InterleaveLower(d, c, e), hn::InterleaveUpper(d, c, e));
  const hn::Repartition<double, D> d64;
  const auto ab64 = hn::BitCast(d64, ab);
  const auto ce64 = hn::BitCast(d64, ce);
  const V blocks = hn::Add(hn::BitCast(d, hn::InterleaveLower(d64, ab64, ce64)),
                           hn::BitCast(d, hn::InterleaveUpper(d64, ab64, ce64)));
  alignas(64) float all[kTile];
  hn::Store(blocks, d, all);
  const hn::Full128<float> d4;
  auto sum = hn::Load(d4, all);
  for (size_t block = 4; block < hn::Lanes(d); block += 4) {
    sum = hn::Add(sum, hn::Load(d4, all + block));
  }
  hn::StoreU(sum, d4, out);
#endif
}

// 1/x for x in [1e-3, 1], nearly to rounding. A step of Newton's doubles the bits that are right:
// at least 12 on x86, 8 on NEON.
HWY_INLINE V reciprocal(D d, V x) {
  const V two = hn::Set(d, 2.0f);
  V r = hn::ApproximateReciprocal(x);
#if !HWY_ARCH_X86
  r = hn::Mul(r, hn::NegMulAdd(x, r, two));
#endif
  return hn::Mul(r, hn::NegMulAdd(x, r, two));
}

// Front to back a second time. What lies behind a splat is what the pixel has in all, less what
// came before and the splat itself; so no list needs to be walked backwards. kChannels: 3, or 1
// where the derivative by all channels is the same and the sum of a splat's colours is all that
// counts.
template <size_t kChannels>
HWY_INLINE void backward_with(const TileInput& tile, const TileUpstream& upstream,
                              const float* background, InstanceGradient* out) {
  const D d;
  const size_t lanes = hn::Lanes(d);
  const V zero = hn::Zero(d), cut = hn::Set(d, tile.max_alpha);
  const auto color_sum = [](const float* color) HWY_ATTR { return color[0] + color[1] + color[2]; };
  alignas(64) float transmittance[kTilePixels];
  // Per pixel: derivative-weighted colour of all that has not been passed yet, background included.
  alignas(64) float behind[kTilePixels];
  std::fill_n(behind, kTilePixels, 0.0f);
  walk<false>(tile, transmittance,
              [&](size_t n, size_t pixel, V, float, V alpha, V before, auto stopped) HWY_ATTR {
                const FastSplat& s = tile.splats[tile.list[n]];
                const V weight = hn::IfThenZeroElse(stopped, hn::Mul(before, alpha));
                V shade;
                if (kChannels == 1) {
                  shade = hn::Set(d, color_sum(s.color));
                } else {
                  shade = zero;
                  for (size_t c = 0; c < 3; ++c) {
                    shade = hn::MulAdd(hn::Load(d, upstream.gradient[c] + pixel),
                                       hn::Set(d, s.color[c]), shade);
                  }
                }
                hn::Store(hn::MulAdd(weight, shade, hn::Load(d, behind + pixel)), d,
                          behind + pixel);
              });
  for (size_t p = 0; p < kTilePixels; p += lanes) {
    const V t = hn::Load(d, transmittance + p);
    V sum = hn::Load(d, behind + p);
    if (kChannels == 1) {
      sum = hn::Mul(hn::MulAdd(t, hn::Set(d, color_sum(background)), sum),
                    hn::Load(d, upstream.gradient[0] + p));
    } else {
      for (size_t c = 0; c < 3; ++c) {
        const V through = hn::Mul(t, hn::Set(d, background[c]));
        sum = hn::MulAdd(through, hn::Load(d, upstream.gradient[c] + p), sum);
      }
    }
    hn::Store(sum, d, behind + p);
  }
  std::fill_n(out, tile.count, InstanceGradient{});
  // Sums over the pixels of one splat, of one row vector each; they meet in `out` when it is
  // passed.
  struct Sums {
    V mean[2], conic[3], log_opacity, color[3], coverage;
  };
  Sums sums{};
  size_t current = ~size_t{0};
  const auto clear = [&]() HWY_ATTR {
    sums.mean[0] = sums.mean[1] = zero;
    for (size_t k = 0; k < 3; ++k) sums.conic[k] = sums.color[k] = zero;
    sums.log_opacity = sums.coverage = zero;
  };
  const auto finish = [&]() HWY_ATTR {
    if (current == ~size_t{0}) return;
    InstanceGradient& g = out[current];
    const FastSplat& s = tile.splats[tile.list[current]];
    float first[4], second[4];
    sum_four(d, sums.mean[0], sums.mean[1], sums.log_opacity, sums.coverage, first);
    sum_four(d, sums.conic[0], sums.conic[1], sums.conic[2], sums.color[0], second);
    // Sums of the derivative by ln(alpha) times dx and dy; the conic's factors are those of log2.
    constexpr float kLn2 = 0.693147181f;
    const float x = kLn2 * first[0], y = kLn2 * first[1];
    g.mean[0] = -(2 * s.conic[0] * x + s.conic[1] * y);
    g.mean[1] = -(s.conic[1] * x + 2 * s.conic[2] * y);
    g.log_opacity = first[2];
    g.coverage = first[3];
    for (size_t k = 0; k < 3; ++k) g.conic[k] = kLn2 * second[k];
    g.color[0] = g.color[1] = g.color[2] = second[3];
    if (kChannels == 3) {
      sum_four(d, sums.color[1], sums.color[2], zero, zero, first);
      g.color[1] = first[0];
      g.color[2] = first[1];
    }
  };
  clear();
  walk<false>(tile, transmittance,
              [&](size_t n, size_t pixel, V dx, float dy, V alpha, V before, auto stopped)
                  HWY_ATTR {
                    if (n != current) {
                      finish();
                      clear();
                      current = n;
                    }
                    const FastSplat& s = tile.splats[tile.list[n]];
                    const V weight = hn::IfThenZeroElse(stopped, hn::Mul(before, alpha));
                    V shade;  // derivative-weighted colour of the splat
                    if (kChannels == 1) {
                      const V g = hn::Load(d, upstream.gradient[0] + pixel);
                      shade = hn::Mul(g, hn::Set(d, color_sum(s.color)));
                      sums.color[0] = hn::MulAdd(g, weight, sums.color[0]);
                    } else {
                      shade = zero;
                      for (size_t c = 0; c < 3; ++c) {
                        const V g = hn::Load(d, upstream.gradient[c] + pixel);
                        shade = hn::MulAdd(g, hn::Set(d, s.color[c]), shade);
                        sums.color[c] = hn::MulAdd(g, weight, sums.color[c]);
                      }
                    }
                    sums.coverage = hn::Add(sums.coverage, weight);
                    // Where the pixel has stopped the weight is 0.
                    const V rest = hn::NegMulAdd(weight, shade, hn::Load(d, behind + pixel));
                    hn::Store(rest, d, behind + pixel);
                    // By alpha: T shade - rest / (1 - alpha); by ln(alpha): times alpha. Cut: none.
                    const V inverse = reciprocal(d, hn::Sub(hn::Set(d, 1.0f), alpha));
                    const V by_log = hn::IfThenZeroElse(
                        hn::Or(stopped, hn::Ge(alpha, cut)),
                        hn::Mul(alpha, hn::NegMulAdd(rest, inverse, hn::Mul(before, shade))));
                    const V vdy = hn::Set(d, dy);
                    const V by_dx = hn::Mul(by_log, dx);
                    const V by_dy = hn::Mul(by_log, vdy);
                    sums.log_opacity = hn::Add(sums.log_opacity, by_log);
                    sums.mean[0] = hn::Add(sums.mean[0], by_dx);
                    sums.mean[1] = hn::Add(sums.mean[1], by_dy);
                    sums.conic[0] = hn::MulAdd(by_dx, dx, sums.conic[0]);
                    sums.conic[1] = hn::MulAdd(by_dx, vdy, sums.conic[1]);
                    sums.conic[2] = hn::MulAdd(by_dy, vdy, sums.conic[2]);
                  });
  finish();
}

void backward(const TileInput& tile, const TileUpstream& upstream, const float* background,
              InstanceGradient* out) {
  if (upstream.one_channel) {
    backward_with<1>(tile, upstream, background, out);
  } else {
    backward_with<3>(tile, upstream, background, out);
  }
}

BlendKernels kernels() { return {blend, blend_fast_exp, coverage, backward}; }

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace l4d::render
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace l4d::render {
HWY_EXPORT(kernels);
BlendKernels blend_kernels() { return HWY_DYNAMIC_DISPATCH(kernels)(); }
}  // namespace l4d::render
#endif
