// SPDX-License-Identifier: Apache-2.0
// Which slots are visible at an instant.
#include "render/cuda/frame/frame.h"
#include "render/cuda/kernel/launch.cuh"
#include "render/cuda/kernel/ordered.cuh"

namespace l4d::render {
namespace {

constexpr int kThreads = 256;
constexpr int kWarps = kThreads / 32;
constexpr int kTurns = kChunkSlots / kThreads;
static_assert(kTurns * kWarps == 32, "one lane per warp and turn");

// kWindows: of slots some of which have windows.
template <bool kWindows>
__global__ void __launch_bounds__(kThreads) slice(ResidentGaussians slots, const Chunk* chunks,
                                                  double time, uint32_t frame, FrameMemory memory) {
  await_predecessor();
  __shared__ uint32_t before[32];  // visible slots before each turn of each warp
  const uint32_t piece = take_ticket(&memory.slice_counts->ticket);
  const Chunk chunk = chunks[piece];
  const float now = slot_time(slots, time, chunk.first);
  const uint32_t lane = threadIdx.x & 31, warp = threadIdx.x / 32;
  uint32_t votes[kTurns];
#pragma unroll
  for (int k = 0; k < kTurns; ++k) {
    const uint32_t at = static_cast<uint32_t>(k) * kThreads + threadIdx.x;
    bool visible = false;
    if (at < chunk.count) {
      visible = slots.interval[chunk.first + at].holds(now) &&
                (!kWindows || slots.window[chunk.first + at].shows(frame));
    }
    votes[k] = __ballot_sync(kFullWarp, visible);
    if (lane == 0)
      before[k * kWarps + static_cast<int>(warp)] = static_cast<uint32_t>(__popc(votes[k]));
  }
  __syncthreads();
  if (warp == 0) {
    const uint32_t own = before[lane];
    const uint32_t until = warp_sum_until(own);
    const uint32_t total = __shfl_sync(kFullWarp, until, 31);
    const uint32_t base = sum_before(memory.slice_states, piece, total);
    before[lane] = base + until - own;
    if (lane == 0 && piece + 1 == gridDim.x) {
      const uint32_t all = base + total;
      memory.slice_counts->visible = min(all, memory.max_visible);
      memory.slice_counts->wanted = all;
    }
  }
  __syncthreads();
#pragma unroll
  for (int k = 0; k < kTurns; ++k) {
    if (((votes[k] >> lane) & 1) == 0) continue;
    const uint32_t at = before[k * kWarps + static_cast<int>(warp)] +
                        static_cast<uint32_t>(__popc(votes[k] & ((1u << lane) - 1)));
    const uint32_t slot = chunk.first + static_cast<uint32_t>(k) * kThreads + threadIdx.x;
    if (at < memory.max_visible) memory.visible[at] = slot | chunk.group << kGroupShift;
  }
}

}  // namespace

void launch_slice(const ResidentGaussians& slots, const Chunk* chunks, uint32_t num_chunks,
                  double time, uint32_t frame, const FrameMemory& memory, cudaStream_t stream) {
  if (num_chunks == 0) return;
  launch(slots.window != nullptr ? slice<true> : slice<false>, num_chunks, kThreads, stream, slots,
         chunks, time, frame, memory);
}

}  // namespace l4d::render
