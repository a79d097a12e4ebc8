// SPDX-License-Identifier: Apache-2.0
// The inner loops of the fast rasteriser.
#pragma once

#include <cstddef>
#include <cstdint>

#include "render/frame/frame.h"
#include "render/view/view.h"

namespace l4d::render {

constexpr int kTile = 16;  // pixels on a side
constexpr int kTilePixels = kTile * kTile;

// A Gaussian in the image, one cache line. At offset (dx, dy) from the mean
//   log2(alpha) = log2_opacity + dx (conic[0] dx + conic[1] dy) + conic[2] dy^2,
// so the conic carries the factors of the exponent.
struct alignas(64) FastSplat {
  float mean[2];   // pixels
  float conic[3];  // xx, 2 xy, yy times -log2(e)/2
  float log2_opacity;
  float log2_least;  // the splat shows where log2(alpha) is at least this
  float color[3];    // clamped below at 0
  float extent[2];   // half-sizes of the box in which it shows, pixels
  float depth;
  uint32_t row;      // in the frame
  uint32_t clamped;  // bit c: color[c] was negative
  float opacity;     // times the compensation
};

// log2(kMinAlpha)
constexpr float kLog2MinAlpha = -7.99435344f;

struct TileInput {
  const FastSplat* splats;  // front to back
  const uint32_t* list;     // [count] which of them touch the tile
  size_t count;
  int x, y;           // first pixel
  int width, height;  // pixels of the tile inside the image
  float max_alpha;
};

// Planes of kTilePixels, rows of kTile.
struct TileImage {
  alignas(64) float transmittance[kTilePixels];
  alignas(64) float rgb[3][kTilePixels];
};

// What the backward pass is given per pixel of a tile, in planes as above. Outside the image all is
// zero.
struct TileUpstream {
  alignas(64) float gradient[3][kTilePixels];  // of the scalar, by each channel
  bool one_channel;                            // the first plane stands for all
};

// Derivatives by one splat from one tile; the units of FastSplat's fields.
struct InstanceGradient {
  float mean[2];
  float conic[3];     // by the three factors of log2(alpha)
  float log_opacity;  // by the natural logarithm of the opacity
  float color[3];
  float coverage;  // sum of alpha times transmittance
};

struct RenderKernels {
  // Makes the splats of rows [begin, end) that touch the view; out has room for all. Returns how
  // many.
  size_t (*project)(const Frame<float>& frame, const View<float>& view, size_t begin, size_t end,
                    FastSplat* out);
  // Front-to-back blending, without background.
  void (*blend)(const TileInput& tile, TileImage* out);
  void (*blend_fast_exp)(const TileInput& tile, TileImage* out);
  // Sum of alpha times transmittance over the tile's pixels, per list entry: out[count].
  void (*coverage)(const TileInput& tile, float* out);
  // out[count]. `background` [3] is what shines through.
  void (*backward)(const TileInput& tile, const TileUpstream& upstream, const float* background,
                   InstanceGradient* out);
};

const RenderKernels& render_kernels();

}  // namespace l4d::render
