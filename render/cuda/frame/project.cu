// SPDX-License-Identifier: Apache-2.0
// From visible slots to splats: position and opacity at the instant, projection, tiles, colour.
#include "render/cuda/frame/frame.h"
#include "render/cuda/kernel/launch.cuh"
#include "render/cuda/kernel/ordered.cuh"
#include "render/cuda/store/stored_sh.cuh"
#include "render/frame/project.h"

namespace l4d::render {
namespace {

// The splat of a slot; false where it touches no pixel. Everything but its colour.
__device__ bool splat_of_row(const ResidentGaussians& slots, const View<float>& view, double time,
                             uint32_t listed, float* position, DeviceSplat* out, float* depth) {
  const uint32_t slot = listed & kSlotMask, group = listed >> kGroupShift;
  const float4 place = __ldg(slots.place + slot);
  const float4 shape0 = __ldg(slots.shape0 + slot);
  const float4 shape1 = __ldg(slots.shape1 + slot);
  position[0] = place.x;
  position[1] = place.y;
  position[2] = place.z;
  float opacity = place.w;
  const float now = slot_time(slots, time, slot);
  if (group == kMoving) {
    const float4 motion = __ldg(slots.motion + slot);
    const float elapsed = now - motion.w;
    position[0] = fmaf(motion.x, elapsed, position[0]);
    position[1] = fmaf(motion.y, elapsed, position[1]);
    position[2] = fmaf(motion.z, elapsed, position[2]);
  }
  if (group != kStill) {
    opacity *= falloff(shape1.w, now - shape1.z);
  }
  if (!(opacity >= static_cast<float>(kMinAlpha))) return false;
  const float covariance[6] = {shape0.x, shape0.y, shape0.z, shape0.w, shape1.x, shape1.y};
  Projection<float> p;
  if (!project_geometry(view, position, covariance, &p)) return false;
  const float* c = p.covariance;
  // The product of two entries must not overflow where a Gaussian is huge; a power of two rounds
  // nothing.
  const float widest = fmaxf(c[0], c[2]);
  const float shrink = widest > 0x1p60f ? 0x1p-64f : 1.0f;
  const float small[3] = {c[0] * shrink, c[1] * shrink, c[2] * shrink};
  const float det = fmaf(small[0], small[2], -small[1] * small[1]);
  if (!(det > 0) || !isfinite(widest)) return false;
  out->log2_opacity = log2f(opacity);
  // reach = 2 ln(opacity / kMinAlpha)
  const float reach = fmaxf(0.0f, 1.38629436f * (out->log2_opacity - kDeviceLog2MinAlpha));
  out->mean[0] = view.fx * p.camera[0] / p.camera[2] + view.cx;
  out->mean[1] = view.fy * p.camera[1] / p.camera[2] + view.cy;
  out->extent[0] = sqrtf(reach * c[0]);
  out->extent[1] = sqrtf(reach * c[2]);
  if (!(out->mean[0] + out->extent[0] >= 0.5f && out->mean[1] + out->extent[1] >= 0.5f &&
        out->mean[0] - out->extent[0] <= static_cast<float>(view.width) - 0.5f &&
        out->mean[1] - out->extent[1] <= static_cast<float>(view.height) - 0.5f)) {
    return false;
  }
  constexpr float kHalfLog2E = 0.72134752f;
  const float scale = -kHalfLog2E / det * shrink;
  out->conic[0] = scale * small[2];
  out->conic[1] = -2 * scale * small[1];
  out->conic_yy = scale * small[0];
  out->slot = listed;
  *depth = p.camera[2];
  return true;
}

template <uint32_t kDegree, bool kHalf, int kThreads = project_piece(kHalf)>
__global__ void __launch_bounds__(kThreads)
    project_rows(ResidentGaussians slots, FrameInput input, FrameMemory memory) {
  await_predecessor();
  __shared__ uint32_t before[kThreads / 32];
  __shared__ uint32_t digits[kMaxSortPasses * kSortRadix];
  FrameCounts* counts = memory.counts;
  const uint32_t n = memory.slice_counts->visible;
  if (blockIdx.x * kThreads >= n) return;
  const uint32_t piece = take_ticket(&counts->project_ticket);
  const uint32_t at = piece * kThreads + threadIdx.x;
  const uint32_t lane = threadIdx.x & 31, warp = threadIdx.x / 32;

  DeviceSplat splat;
  float position[3], depth = 0;
  StoredSh<kDegree, kHalf> sh;
  const bool shown = at < n && splat_of_row(slots, input.view, input.time, memory.visible[at],
                                            position, &splat, &depth);
  // The longest loads begin before anything waits for other warps.
  if (shown) sh.load(slots, splat.slot & kSlotMask);
  clear_digits<kThreads>(input.depth_digits, digits);
  const uint32_t votes = __ballot_sync(kFullWarp, shown);
  if (lane == 0) before[warp] = static_cast<uint32_t>(__popc(votes));
  __syncthreads();
  if (warp == 0) {
    const uint32_t own = lane < kThreads / 32 ? before[lane] : 0;
    const uint32_t until = warp_sum_until(own);
    const uint32_t total = __shfl_sync(kFullWarp, until, 31);
    const uint32_t base = sum_before(memory.project_states, piece, total);
    if (lane < kThreads / 32) before[lane] = base + until - own;
    if (lane == 0 && (piece + 1) * kThreads >= n) counts->projected = base + total;
  }
  // Bits of floats above 0 order as the floats do.
  const uint32_t key = __float_as_uint(depth);
  if (shown) {
    count_digits(input.depth_digits, key, digits);
    float direction[3] = {0, 0, 1};
    if (kDegree > 0) view_direction(input.view, position, direction);
    sh_color(kDegree, sh, direction, splat.color);
    for (float& channel : splat.color) channel = fmaxf(channel, 0.0f);
  }
  __syncthreads();
  add_digits<kThreads>(input.depth_digits, digits, memory.depth_histograms);
  if (!shown) return;
  const uint32_t to = before[warp] + static_cast<uint32_t>(__popc(votes & ((1u << lane) - 1)));
  float4* words = reinterpret_cast<float4*>(memory.splats + to);
  words[0] = make_float4(splat.mean[0], splat.mean[1], splat.conic[0], splat.conic[1]);
  words[1] = make_float4(splat.conic_yy, splat.log2_opacity, splat.extent[0], splat.extent[1]);
  words[2] =
      make_float4(splat.color[0], splat.color[1], splat.color[2], __uint_as_float(splat.slot));
  memory.depth_keys[0][to] = key;
}

using Kernel = void (*)(ResidentGaussians, FrameInput, FrameMemory);

template <bool kHalf>
Kernel kernel_of(uint32_t degree) {
  switch (degree) {
    case 0:
      return project_rows<0, kHalf>;
    case 1:
      return project_rows<1, kHalf>;
    case 2:
      return project_rows<2, kHalf>;
    default:
      return project_rows<3, kHalf>;
  }
}

}  // namespace

void launch_project(const ResidentGaussians& slots, const FrameInput& input,
                    const FrameMemory& memory, cudaStream_t stream) {
  const unsigned threads = static_cast<unsigned>(project_piece(input.half_sh));
  const unsigned grid = (memory.max_visible + threads - 1) / threads;
  const Kernel kernel =
      input.half_sh ? kernel_of<true>(input.sh_degree) : kernel_of<false>(input.sh_degree);
  launch(kernel, grid, threads, stream, slots, input, memory);
}

}  // namespace l4d::render
