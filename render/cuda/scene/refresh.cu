// SPDX-License-Identifier: Apache-2.0
#include "render/cuda/kernel/launch.cuh"
#include "render/cuda/scene/refresh.h"
#include "render/cuda/store/store.h"

namespace l4d::render {
namespace {

constexpr int kThreads = 128;

// A sum is finite only if all of its terms are.
__device__ bool is_finite(const Prepared& p) {
  double sum = p.mean + p.opacity + p.reference + p.slice.lambda;
  for (int k = 0; k < 3; ++k) sum += p.position[k] + p.slice.velocity[k];
  for (int k = 0; k < 6; ++k) sum += p.slice.covariance[k];
  return isfinite(sum);
}

__global__ void __launch_bounds__(kThreads)
    refresh(l4d_gaussians gaussians, const uint32_t* count, Sequence sequence,
            ResidentGaussians slots, TrainableCounts* counts) {
  await_predecessor();
  const uint32_t capacity = static_cast<uint32_t>(gaussians.count);
  const uint32_t rows = count == nullptr ? capacity : min(*count, capacity);
  const uint32_t i = blockIdx.x * kThreads + threadIdx.x;
  if (i == 0) counts->rows = rows;
  if (i >= capacity) return;
  if (i < rows) {
    const Prepared p = prepare_gaussian(gaussians, sequence, i);
    if (is_finite(p)) return store_slot(p, sequence.center(), i, i, slots);
  }
  slots.interval[i] = {1.0f, 0.0f};
}

__global__ void note_view(FrameMemory memory, bool first, TrainableCounts* counts,
                          uint32_t* overflow) {
  await_predecessor();
  const uint32_t visible = memory.slice_counts->wanted, instances = memory.counts->wanted;
  atomicAdd(&counts->views, 1ull);
  if (!is_whole(memory)) {
    atomicAdd(&counts->skipped, 1ull);
    if (overflow != nullptr) atomicExch(overflow, 1u);
  }
  atomicMax(&counts->required_visible, visible);
  atomicMax(&counts->required_instances, instances);
  if (!first) return;
  counts->visible = memory.slice_counts->visible;
  counts->projected = memory.counts->projected;
  counts->instances = memory.counts->instances;
}

}  // namespace

void launch_refresh(const l4d_gaussians& gaussians, const uint32_t* count, const Sequence& sequence,
                    const ResidentGaussians& slots, TrainableCounts* counts, cudaStream_t stream) {
  const unsigned grid = static_cast<unsigned>((gaussians.count + kThreads - 1) / kThreads);
  if (grid == 0) return;
  launch(refresh, grid, kThreads, stream, gaussians, count, sequence, slots, counts);
}

void launch_note_view(const FrameMemory& memory, bool first, TrainableCounts* counts,
                      uint32_t* overflow, cudaStream_t stream) {
  launch(note_view, 1, 1, stream, memory, first, counts, overflow);
}

}  // namespace l4d::render
