// SPDX-License-Identifier: Apache-2.0
// How a block of threads walks the list of its tile, forward and backward alike: splats come to
// shared memory in batches, and each warp picks those that reach its own pixels.
#pragma once

#include <cuda_pipeline.h>

#include "render/cuda/frame/frame.h"
#include "render/cuda/kernel/ordered.cuh"

namespace l4d::render {

constexpr int kSide = 8;     // pixels of a square
constexpr int kRowStep = 4;  // a thread has two pixels of a square, one so far below the other

// A block of threads blends a tile, or a part of it that is kWidth pixels wide; a warp has kSquares
// squares of it beside each other.
template <int kWidth, int kSquaresOfWarp>
struct BlockOfTile {
  static constexpr int kSquares = kSquaresOfWarp;
  static constexpr int kParts = kTileWidth / kWidth;
  static constexpr int kWarpColumns = kWidth / (kSide * kSquares);
  static constexpr int kWarps = kWarpColumns * (kTileHeight / kSide);
  static constexpr int kThreads = 32 * kWarps;
  int x, y;     // first pixel
  uint2 range;  // of the tile's instances

  __device__ BlockOfTile(const FrameInput& input, const FrameMemory& memory) {
    const uint32_t tile = memory.tile_order[blockIdx.x / kParts];
    const int part = static_cast<int>(blockIdx.x % kParts);
    x = static_cast<int>(tile) % input.columns * kTileWidth + part * kWidth;
    y = static_cast<int>(tile) / input.columns * kTileHeight;
    range = memory.ranges[tile];
  }
};

// Pixel centres of a warp.
struct WarpPixels {
  int x, y;                // the thread's first pixel
  float left, right, top;  // of the squares
  template <int kWidth, int kSquares>
  __device__ explicit WarpPixels(const BlockOfTile<kWidth, kSquares>& block) {
    const int lane = static_cast<int>(threadIdx.x & 31), warp = static_cast<int>(threadIdx.x / 32);
    const int x0 = block.x + warp % block.kWarpColumns * kSide * kSquares;
    const int y0 = block.y + warp / block.kWarpColumns * kSide;
    x = x0 + (lane & 7);
    y = y0 + (lane >> 3);
    left = static_cast<float>(x0) + 0.5f;
    right = left + static_cast<float>(kSide * kSquares - 1);
    top = static_cast<float>(y0) + 0.5f;
  }
};

// Whether alpha reaches kMinAlpha within a warp's pixel centres, by its largest value there. A hair
// of slack: each pixel decides for itself later.
__device__ inline bool reaches_warp(const DeviceSplat& s, const WarpPixels& pixels) {
  constexpr float kSlack = 0.01f;
  const float x0 = pixels.left - s.mean[0], x1 = pixels.right - s.mean[0];
  const float y0 = pixels.top - s.mean[1], y1 = y0 + static_cast<float>(kSide - 1);
  const float x = fminf(fmaxf(0.0f, x0), x1), y = fminf(fmaxf(0.0f, y0), y1);
  // The largest value lies on an edge that faces the mean: x = const or y = const.
  const float a = s.conic[0], b = s.conic[1], c = s.conic_yy;
  const float best_y = fminf(fmaxf(__fdividef(-0.5f * b * x, c), y0), y1);
  const float best_x = fminf(fmaxf(__fdividef(-0.5f * b * y, a), x0), x1);
  const float on_x = fmaf(x, fmaf(a, x, b * best_y), c * best_y * best_y);
  const float on_y = fmaf(best_x, fmaf(a, best_x, b * y), c * y * y);
  return fmaxf(on_x, on_y) + s.log2_opacity >= kDeviceLog2MinAlpha - kSlack;
}

__device__ inline float exp2_fast(float x) {
  float y;
  asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x));
  return y;
}

// Walks the tile's list. place(i) is the splat of list entry i; visit(entry, splat) is called by
// whole warps, for entries in order, of splats that reach the warp's pixels; warp_done() says
// whether the warp has no pixel left, after(first, count) is called by the whole block between
// barriers when a batch has been passed by all warps. kBatch: splats of a batch, a multiple of 32
// and one per thread at most.
template <int kBatch, class Place, class Visit, class WarpDone, class After>
__device__ inline void walk_tile(const DeviceSplat* splats, uint32_t count,
                                 const WarpPixels& pixels, DeviceSplat (*batch)[kBatch] /* [2] */,
                                 const Place& place, const Visit& visit, const WarpDone& warp_done,
                                 const After& after) {
  const uint32_t t = threadIdx.x, lane = t & 31;
  const auto fetch = [&](uint32_t first, int buffer, uint32_t splat) {
    if (t < kBatch && first + t < count) {
      const char* from = reinterpret_cast<const char*>(splats + splat);
      char* to = reinterpret_cast<char*>(&batch[buffer][t]);
#pragma unroll
      for (int k = 0; k < 48; k += 16) __pipeline_memcpy_async(to + k, from + k, 16);
    }
    __pipeline_commit();
  };
  const auto place_of = [&](uint32_t first) {
    return t < kBatch && first + t < count ? place(first + t) : 0u;
  };
  fetch(0, 0, place_of(0));
  uint32_t next = place_of(kBatch);
  bool done = warp_done();
  int buffer = 0;
  for (uint32_t first = 0; first < count; first += kBatch, buffer ^= 1) {
    fetch(first + kBatch, buffer ^ 1, next);
    next = place_of(first + 2 * kBatch);
    __pipeline_wait_prior(1);
    __syncthreads();
    const uint32_t here = min(count - first, static_cast<uint32_t>(kBatch));
    for (uint32_t group = 0; group < here && !done; group += 32) {
      const bool reaches = group + lane < here && reaches_warp(batch[buffer][group + lane], pixels);
      for (uint32_t votes = __ballot_sync(kFullWarp, reaches); votes != 0; votes &= votes - 1) {
        const uint32_t k = group + static_cast<uint32_t>(__ffs(static_cast<int>(votes)) - 1);
        visit(first + k, batch[buffer][k]);
      }
      done = warp_done();
    }
    const bool all_done = __syncthreads_and(done) != 0;
    after(first, here);
    if (all_done) {
      __pipeline_wait_prior(0);
      break;
    }
  }
}

}  // namespace l4d::render
