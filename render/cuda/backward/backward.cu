// SPDX-License-Identifier: Apache-2.0
// Front to back a second time. What lies behind a splat is what the pixel has in all, less what
// came before and the splat itself; so no list needs to be walked backwards.
#include "render/cuda/backward/backward.h"
#include "render/cuda/frame/blend.cuh"
#include "render/cuda/kernel/launch.cuh"

namespace l4d::render {
namespace {

// A whole tile, so that one block has all of an instance; or a part of it.
template <int kParts>
using PartOfTile = BlockOfTile<kTileWidth / kParts, 1>;
using Block = PartOfTile<1>;
constexpr int kPixels = 2 * Block::kSquares;  // of a thread
// The sums of more splats would leave no room for other blocks.
constexpr int kBatch = 64;
constexpr float kStop = static_cast<float>(kMinTransmittance);
constexpr float kCut = static_cast<float>(kMaxAlpha);

// Numbers that are summed over pixels: those of SplatSums, in its order.
template <int kChannels, bool kError>
constexpr int kSums = kChannels == 1 ? 8
                      : kError       ? 11
                                     : 10;

template <int kChannels, bool kError>
struct Pixel {
  float transmittance = 1, behind = 0;
  float gradient[kChannels];
  float error = 0;
  float threshold = kDeviceLog2MinAlpha;  // infinite where the pixel is done

  __device__ bool done() const { return threshold > 0; }

  // Adds what the pixel says about the splat.
  __device__ void pass(float log2_alpha, float dx, float dy, const DeviceSplat& s,
                       float* sums /* [kSums] */) {
    if (!(log2_alpha >= threshold)) return;
    const float whole = exp2_fast(log2_alpha);
    const float alpha = fminf(whole, kCut);
    const float weight = transmittance * alpha;
    const float left = transmittance - weight;
    if (left < kStop) {
      threshold = INFINITY;
      return;
    }
    float shade;
    if (kChannels == 1) {
      shade = s.color[0] + s.color[1] + s.color[2];
    } else {
      shade = 0;
#pragma unroll
      for (int c = 0; c < kChannels; ++c) shade = fmaf(gradient[c], s.color[c], shade);
#pragma unroll
      for (int c = 0; c < kChannels; ++c) sums[7 + c] = fmaf(gradient[c], weight, sums[7 + c]);
    }
    sums[3] += weight;
    if constexpr (kError) sums[10] = fmaf(error, weight, sums[10]);
    behind = fmaf(-weight, shade, behind);
    // By alpha: T shade - behind / (1 - alpha); by ln(alpha): times alpha. Cut: none.
    const float inverse = __fdividef(1.0f, 1.0f - alpha);
    const float by_alpha = fmaf(-behind, inverse, transmittance * shade);
    transmittance = left;
    if (whole >= kCut) return;
    const float by_log = alpha * by_alpha;
    const float x = by_log * dx, y = by_log * dy;
    sums[0] += by_log;
    sums[1] += x;
    sums[2] += y;
    sums[4] = fmaf(x, dx, sums[4]);
    sums[5] = fmaf(x, dy, sums[5]);
    sums[6] = fmaf(y, dy, sums[6]);
  }
};

// What the scalar has of a pixel in all.
template <int kChannels, bool kError>
__device__ void start(const FrameInput& input, const BackwardTask& task, int x, int y,
                      Pixel<kChannels, kError>* pixel) {
  if (x >= input.view.width || y >= input.view.height) {
    pixel->threshold = INFINITY;
    return;
  }
  const size_t at =
      static_cast<size_t>(y) * static_cast<size_t>(input.view.width) + static_cast<size_t>(x);
  const float rgb[3] = {task.rgb[3 * at], task.rgb[3 * at + 1], task.rgb[3 * at + 2]};
  if (kChannels == 1) {
    pixel->behind = rgb[0] + rgb[1] + rgb[2];
    return;
  }
  if constexpr (kError) pixel->error = task.error[at];
  const uint64_t bits = task.upstream == Upstream::kSigns ? mix(task.signs + at) : 0;
#pragma unroll
  for (int c = 0; c < kChannels; ++c) {
    pixel->gradient[c] = task.upstream == Upstream::kSigns
                             ? sign_of(bits, c)
                             : task.rgb_gradient[3 * at + static_cast<size_t>(c)];
    pixel->behind = fmaf(pixel->gradient[c], rgb[c], pixel->behind);
  }
}

// Sums 8 numbers over a warp; lanes 4 k .. 4 k + 3 end with number k's. Half of what is left is
// handed over in each step, a third of the work of one number at a time.
__device__ float sum_eight(const float* v) {
  const uint32_t lane = threadIdx.x & 31;
  float four[4], two[2];
  const bool high16 = (lane & 16) != 0, high8 = (lane & 8) != 0, high4 = (lane & 4) != 0;
#pragma unroll
  for (int k = 0; k < 4; ++k) {
    const float other = __shfl_xor_sync(kFullWarp, high16 ? v[k] : v[k + 4], 16);
    four[k] = (high16 ? v[k + 4] : v[k]) + other;
  }
#pragma unroll
  for (int k = 0; k < 2; ++k) {
    const float other = __shfl_xor_sync(kFullWarp, high8 ? four[k] : four[k + 2], 8);
    two[k] = (high8 ? four[k + 2] : four[k]) + other;
  }
  const float other = __shfl_xor_sync(kFullWarp, high4 ? two[0] : two[1], 4);
  float sum = (high4 ? two[1] : two[0]) + other;
  sum += __shfl_xor_sync(kFullWarp, sum, 2);
  sum += __shfl_xor_sync(kFullWarp, sum, 1);
  return sum;
}

// Likewise of 2: lanes 0..15 end with the first's, the others with the second's.
__device__ float sum_two(const float* v) {
  const bool high = (threadIdx.x & 16) != 0;
  float sum = (high ? v[1] : v[0]) + __shfl_xor_sync(kFullWarp, high ? v[0] : v[1], 16);
#pragma unroll
  for (int step = 8; step > 0; step /= 2) sum += __shfl_xor_sync(kFullWarp, sum, step);
  return sum;
}

// Likewise of 3, whose lanes 24..31 end with nothing.
__device__ float sum_three(const float* v) {
  const bool high16 = (threadIdx.x & 16) != 0, high8 = (threadIdx.x & 8) != 0;
  const float a = (high16 ? v[2] : v[0]) + __shfl_xor_sync(kFullWarp, high16 ? v[0] : v[2], 16);
  const float b = (high16 ? 0.0f : v[1]) + __shfl_xor_sync(kFullWarp, high16 ? v[1] : 0.0f, 16);
  float sum = (high8 ? b : a) + __shfl_xor_sync(kFullWarp, high8 ? a : b, 8);
#pragma unroll
  for (int step = 4; step > 0; step /= 2) sum += __shfl_xor_sync(kFullWarp, sum, step);
  return sum;
}

template <int kChannels, bool kError, int kParts>
__global__ void __launch_bounds__(PartOfTile<kParts>::kThreads)
    backward(FrameInput input, BackwardTask task, const uint32_t* values, FrameMemory memory,
             SplatSums* instances) {
  await_predecessor();
  using Own = PartOfTile<kParts>;
  constexpr int kNumbers = kSums<kChannels, kError>, kWarps = Own::kWarps;
  static_assert(kBatch <= Own::kThreads, "one thread adds up one splat");
  __shared__ DeviceSplat batch[2][kBatch];
  // Of each warp and entry of the batch. One more column, so that a warp's numbers lie in different
  // banks.
  __shared__ float sums[kWarps][kNumbers][kBatch + 1];
  __shared__ uint32_t passed[kWarps][kBatch / 32];  // entries that the warp has sums of
  const uint32_t lane = threadIdx.x & 31, warp = threadIdx.x / 32;
  const Own block(input, memory);
  const uint32_t part = blockIdx.x % kParts;
  const WarpPixels pixels(block);
  const uint2 range = block.range;
  const uint32_t count = range.y - range.x;
  Pixel<kChannels, kError> pixel[kPixels];
#pragma unroll
  for (int k = 0; k < kPixels; ++k) {
    start(input, task, pixels.x + k / 2 * kSide, pixels.y + k % 2 * kRowStep, &pixel[k]);
  }
  const float px = static_cast<float>(pixels.x) + 0.5f, py = static_cast<float>(pixels.y) + 0.5f;
  if (lane < kBatch / 32) passed[warp][lane] = 0;
  uint32_t left_off = 0;
  walk_tile<kBatch>(
      memory.splats, count, pixels, batch,
      [&](uint32_t entry) { return memory.splat_of[values[range.x + entry]]; },
      [&](uint32_t entry, const DeviceSplat& s) {
        float log2_alpha[kPixels];
        bool any = false;
#pragma unroll
        for (int k = 0; k < kPixels; ++k) {
          const float dx = px + static_cast<float>(k / 2 * kSide) - s.mean[0];
          const float dy = py + static_cast<float>(k % 2 * kRowStep) - s.mean[1];
          log2_alpha[k] = fmaf(dy, fmaf(s.conic_yy, dy, s.conic[1] * dx),
                               fmaf(s.conic[0] * dx, dx, s.log2_opacity));
          any = any || log2_alpha[k] >= pixel[k].threshold;
        }
        if (!__any_sync(kFullWarp, any)) return;
        float own[kNumbers] = {};
#pragma unroll
        for (int k = 0; k < kPixels; ++k) {
          const float dx = px + static_cast<float>(k / 2 * kSide) - s.mean[0];
          const float dy = py + static_cast<float>(k % 2 * kRowStep) - s.mean[1];
          pixel[k].pass(log2_alpha[k], dx, dy, s, own);
        }
        const uint32_t place = entry % kBatch;
        const float eight = sum_eight(own);
        if ((lane & 3) == 0) sums[warp][lane / 4][place] = eight;
        if constexpr (kError) {
          const float three = sum_three(own + 8);
          if ((lane & 7) == 0 && lane < 24) sums[warp][8 + lane / 8][place] = three;
        } else if constexpr (kChannels == 3) {
          const float two = sum_two(own + 8);
          if ((lane & 15) == 0) sums[warp][8 + lane / 16][place] = two;
        }
        if (lane == 0) passed[warp][place / 32] |= 1u << (place % 32);
      },
      [&] {
        bool done = true;
#pragma unroll
        for (int k = 0; k < kPixels; ++k) done = done && pixel[k].done();
        return __all_sync(kFullWarp, done) != 0;
      },
      [&](uint32_t first, uint32_t here) {
        const uint32_t place = threadIdx.x;
        if (place < here) {
          float total[kNumbers] = {};
          for (int w = 0; w < kWarps; ++w) {
            if ((passed[w][place / 32] >> (place % 32) & 1) == 0) continue;
#pragma unroll
            for (int k = 0; k < kNumbers; ++k) total[k] += sums[w][k][place];
          }
          float4* to = reinterpret_cast<float4*>(instances +
                                                 kParts * values[range.x + first + place] + part);
          to[0] = make_float4(total[0], total[1], total[2], total[3]);
          if (total[3] > 0) {
            to[1] = make_float4(total[4], total[5], total[6], total[7]);
            if constexpr (kChannels == 3) {
              to[2] = make_float4(total[8], total[9], kError ? total[kNumbers - 1] : 0, 0);
            }
          }
        }
        left_off = first + here;
        __syncthreads();
        if (lane < kBatch / 32) passed[warp][lane] = 0;
        __syncwarp();
      });
  // What lies behind the last pixel's stop.
  for (uint32_t entry = left_off + threadIdx.x; entry < count; entry += Own::kThreads) {
    instances[kParts * values[range.x + entry] + part].coverage = 0;
  }
}

__global__ void __launch_bounds__(Block::kThreads)
    cover(FrameInput input, const uint32_t* values, FrameMemory memory,
          unsigned long long* coverage) {
  await_predecessor();
  __shared__ DeviceSplat batch[2][kBatch];
  const Block block(input, memory);
  const WarpPixels pixels(block);
  const uint2 range = block.range;
  float transmittance[kPixels], threshold[kPixels];
#pragma unroll
  for (int k = 0; k < kPixels; ++k) {
    const bool outside = pixels.x + k / 2 * kSide >= input.view.width ||
                         pixels.y + k % 2 * kRowStep >= input.view.height;
    transmittance[k] = 1;
    threshold[k] = outside ? INFINITY : kDeviceLog2MinAlpha;
  }
  const float px = static_cast<float>(pixels.x) + 0.5f, py = static_cast<float>(pixels.y) + 0.5f;
  walk_tile<kBatch>(
      memory.splats, range.y - range.x, pixels, batch,
      [&](uint32_t entry) { return values[range.x + entry]; },
      [&](uint32_t entry, const DeviceSplat& s) {
        float sum = 0;
#pragma unroll
        for (int k = 0; k < kPixels; ++k) {
          const float dx = px + static_cast<float>(k / 2 * kSide) - s.mean[0];
          const float dy = py + static_cast<float>(k % 2 * kRowStep) - s.mean[1];
          const float base = fmaf(s.conic[0] * dx, dx, s.log2_opacity);
          const float log2_alpha = fmaf(dy, fmaf(s.conic_yy, dy, s.conic[1] * dx), base);
          if (!(log2_alpha >= threshold[k])) continue;
          const float weight = transmittance[k] * fminf(exp2_fast(log2_alpha), kCut);
          const float left = transmittance[k] - weight;
          if (left < kStop) {
            threshold[k] = INFINITY;
          } else {
            transmittance[k] = left;
            sum += weight;
          }
        }
        // 128 pixels of at most 2^24 units.
        const uint32_t units = __float2uint_rn(sum * (1.0f / kCoverageUnit));
        const uint32_t total = sum_of_warp(units);
        if (total != 0 && (threadIdx.x & 31) == 0) {
          atomicAdd(coverage + values[range.x + entry], static_cast<unsigned long long>(total));
        }
      },
      [&] {
        bool done = true;
#pragma unroll
        for (int k = 0; k < kPixels; ++k) done = done && threshold[k] > 0;
        return __all_sync(kFullWarp, done) != 0;
      },
      [](uint32_t, uint32_t) {});
}

// Splats of more tiles than this are summed up by a whole warp.
constexpr uint32_t kManyTiles = 64;

template <int kWords>
__device__ void add_words(const SplatSums* from, float4* sum) {
  const float4* words = reinterpret_cast<const float4*>(from);
  const float4 first = words[0];
  if (!(first.w > 0)) return;
#pragma unroll
  for (int k = 0; k < kWords; ++k) {
    const float4 w = k == 0 ? first : words[k];
    sum[k].x += w.x;
    sum[k].y += w.y;
    sum[k].z += w.z;
    sum[k].w += w.w;
  }
}

template <int kWords>
__global__ void __launch_bounds__(256)
    sum_instances(const uint32_t* order, FrameMemory memory, BackwardMemory back) {
  await_predecessor();
  const uint32_t n = memory.counts->projected;
  const uint32_t rank = blockIdx.x * 256 + threadIdx.x;
  const uint32_t lane = threadIdx.x & 31;
  if (blockIdx.x * 256 >= n) return;
  const uint32_t splat = rank < n ? order[rank] : 0;
  uint32_t tiles = rank < n ? memory.num_tiles[splat] : 0;
  const uint32_t first = tiles > 0 ? memory.first_instance[splat] : 0;
  // Of a frame with too many instances the last are missing.
  tiles = min(tiles, memory.max_instances - min(first, memory.max_instances)) * back.parts;
  const uint32_t begin = first * back.parts;  // below 2^27
  float4 sum[kWords] = {};
  if (tiles <= kManyTiles) {
    for (uint32_t k = 0; k < tiles; ++k) add_words<kWords>(back.instances + begin + k, sum);
  }
  for (uint32_t large = __ballot_sync(kFullWarp, tiles > kManyTiles); large != 0;
       large &= large - 1) {
    const int from = __ffs(static_cast<int>(large)) - 1;
    const uint32_t its_first = __shfl_sync(kFullWarp, begin, from);
    const uint32_t its_tiles = __shfl_sync(kFullWarp, tiles, from);
    float4 part[kWords] = {};
    for (uint32_t k = lane; k < its_tiles; k += 32) {
      add_words<kWords>(back.instances + its_first + k, part);
    }
    float* numbers = reinterpret_cast<float*>(part);
#pragma unroll
    for (int k = 0; k < 4 * kWords; ++k) {
#pragma unroll
      for (int step = 16; step > 0; step /= 2) {
        numbers[k] += __shfl_xor_sync(kFullWarp, numbers[k], step);
      }
    }
    if (static_cast<int>(lane) == from) {
#pragma unroll
      for (int k = 0; k < kWords; ++k) sum[k] = part[k];
    }
  }
  // Those that go on come close together: what follows is long, and few of a warp would take part.
  const bool shown = rank < n && sum[0].w > 0;
  const uint32_t votes = __ballot_sync(kFullWarp, shown);
  uint32_t base = 0;
  if (lane == 0 && votes != 0) {
    base = atomicAdd(&memory.counts->shown, static_cast<uint32_t>(__popc(votes)));
  }
  base = __shfl_sync(kFullWarp, base, 0);
  if (!shown) return;
  back.shown[base + static_cast<uint32_t>(__popc(votes & ((1u << lane) - 1)))] = splat;
  float4* to = reinterpret_cast<float4*>(back.splats + splat);
#pragma unroll
  for (int k = 0; k < kWords; ++k) to[k] = sum[k];
}

template <int kParts>
void launch_parts(const FrameInput& input, const BackwardTask& task, const uint32_t* values,
                  const FrameMemory& memory, SplatSums* instances, cudaStream_t stream) {
  const auto kernel = task.upstream == Upstream::kOnes ? backward<1, false, kParts>
                      : task.error == nullptr          ? backward<3, false, kParts>
                                                       : backward<3, true, kParts>;
  const unsigned grid = static_cast<unsigned>(input.columns * input.rows * kParts);
  launch(kernel, grid, PartOfTile<kParts>::kThreads, stream, input, task, values, memory,
         instances);
}

}  // namespace

void launch_backward(const FrameInput& input, const BackwardTask& task, const uint32_t* values,
                     const FrameMemory& memory, const BackwardMemory& back, cudaStream_t stream) {
  if (back.parts == 1) {
    launch_parts<1>(input, task, values, memory, back.instances, stream);
  } else {
    launch_parts<2>(input, task, values, memory, back.instances, stream);
  }
}

void launch_sum_instances(const FrameInput&, const BackwardTask& task, const uint32_t* order,
                          const FrameMemory& memory, const BackwardMemory& back,
                          cudaStream_t stream) {
  const unsigned grid = (memory.max_visible + 255) / 256;
  if (task.upstream == Upstream::kOnes) {
    launch(sum_instances<2>, grid, 256, stream, order, memory, back);
  } else {
    launch(sum_instances<3>, grid, 256, stream, order, memory, back);
  }
}

void launch_coverage(const FrameInput& input, const uint32_t* values, const FrameMemory& memory,
                     unsigned long long* coverage, cudaStream_t stream) {
  const unsigned grid = static_cast<unsigned>(input.columns * input.rows);
  launch(cover, grid, Block::kThreads, stream, input, values, memory, coverage);
}

}  // namespace l4d::render
