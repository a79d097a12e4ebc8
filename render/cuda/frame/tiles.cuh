// SPDX-License-Identifier: Apache-2.0
// Which tiles a splat touches: those where the ellipse in which its alpha reaches kMinAlpha meets
// the rectangle of the tile's pixel centres.
#pragma once

#include "render/cuda/store/resident.h"

namespace l4d::render {

struct TileSpan {
  int begin, end;
};

// Tiles that hold pixel centres of [low, high], a hair wider for rounding. kSide: pixels, a power
// of 2.
template <int kSide>
__device__ inline TileSpan tiles_between(float low, float high, int tiles) {
  constexpr float kSlack = 1e-3f;
  constexpr float kPerTile = 1.0f / kSide;
  const float limit = static_cast<float>(tiles);
  const float last = (high - 0.5f + kSlack) * kPerTile;
  // A tile's last pixel centre lies a pixel before the next tile's first: low rounds up to a pixel.
  const float first = floorf(ceilf(fmaxf(low - 0.5f - kSlack, 0.0f)) * kPerTile);
  if (!(last >= 0) || !(first < limit)) return {0, 0};
  return {static_cast<int>(first), static_cast<int>(fminf(last, limit - 1)) + 1};
}

// A splat's ellipse a x^2 + 2 b x y + c y^2 >= level about its mean, ready for many rows: from the
// first two words of a DeviceSplat to (mean x, mean y, extent x, extent y) and (b / a, c / a, level
// / a, y where the ellipse is widest to the right).
__device__ inline void prepare_ellipse(float4 first, float4 second, float4* out0, float4* out1) {
  const float inverse = 1.0f / first.z, b = 0.5f * first.w, c = second.x;
  *out0 = make_float4(first.x, first.y, second.z, second.w);
  *out1 = make_float4(b * inverse, c * inverse, (kDeviceLog2MinAlpha - second.y) * inverse,
                      -second.z * b / c);
}

// Where the ellipse crosses the line at y, to the right (sign 1) or left: x^2 + 2 b x y + c y^2 =
// level. Spans are worked out twice where they are many, so no compiler may round here as it likes.
__device__ inline float ellipse_edge(float4 ellipse, float y, float sign) {
  const float by = __fmul_rn(ellipse.x, y);
  const float rest = __fmaf_rn(__fmul_rn(ellipse.y, y), y, -ellipse.z);
  const float half2 = fmaxf(__fmaf_rn(by, by, -rest), 0.0f);
  float half;
  asm("sqrt.approx.f32 %0, %1;" : "=f"(half) : "f"(half2));
  return __fmaf_rn(sign, half, -by);
}

// The columns of a row of tiles that the ellipse touches.
__device__ inline TileSpan span_of_row(float4 box, float4 ellipse, int row, int columns) {
  const float top = static_cast<float>(row * kTileHeight) + 0.5f - box.y;
  const float bottom = top + static_cast<float>(kTileHeight - 1);
  if (bottom < -box.w || top > box.w) return {0, 0};
  const float at_right = fminf(fmaxf(ellipse.w, top), bottom);
  const float at_left = fminf(fmaxf(-ellipse.w, top), bottom);
  const float right = at_right == ellipse.w ? box.z : ellipse_edge(ellipse, at_right, 1.0f);
  const float left = at_left == -ellipse.w ? -box.z : ellipse_edge(ellipse, at_left, -1.0f);
  return tiles_between<kTileWidth>(box.x + left, box.x + right, columns);
}

}  // namespace l4d::render
