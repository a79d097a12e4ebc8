// SPDX-License-Identifier: Apache-2.0
#include "training/cuda/relocate_device.h"
#include "training/density/relocate_row.h"

namespace l4d::train {
namespace {

constexpr uint32_t kThreads = 256;

// Sum over a block before each thread, and of all.
template <typename T>
__device__ T sum_before(T value, T* total) {
  __shared__ T sums[kThreads];
  const uint32_t t = threadIdx.x;
  __syncthreads();
  sums[t] = value;
  __syncthreads();
  for (uint32_t step = 1; step < kThreads; step *= 2) {
    const T other = t >= step ? sums[t - step] : T{0};
    __syncthreads();
    sums[t] += other;
    __syncthreads();
  }
  *total = sums[kThreads - 1];
  return t > 0 ? sums[t - 1] : T{0};
}

__device__ bool can_draw(const DensityArrays& a) {
  return a.sampled > 0 && a.cumulative[a.sampled - 1] > 0;
}
__device__ void add_child(const RelocationMemory& memory, uint64_t at, uint64_t target,
                          uint64_t row) {
  memory.children[2 * at] = target;
  memory.children[2 * at + 1] = row;
  atomicAdd(memory.copies + target, 1u);
}

// Dead rows of the step's share, in any order: what becomes of a row does not depend on it.
__global__ void __launch_bounds__(kThreads)
    find_dead(DensityStep s, DensityArrays a, RelocationMemory memory,
              DeviceDensityChange* change) {
  const uint64_t i = uint64_t{blockIdx.x} * kThreads + threadIdx.x;
  if (i >= s.count || a.id[i] % s.cycle != s.turn || !is_dead(s, a, i) || !can_draw(a)) {
    return;
  }
  const uint64_t target = target_of(s, a, a.id[i]);
  if (target == kNoTarget) return;
  add_child(memory, atomicAdd(&change->relocated, 1ull), target, i);
}

// Births take rows in the order of their ids. One block, after find_dead.
__global__ void __launch_bounds__(kThreads)
    add_births(DensityStep s, DensityArrays a, RelocationMemory memory,
               DeviceDensityChange* change) {
  if (!can_draw(a)) return;
  uint64_t born = 0;
  for (uint64_t first = 0; first < s.births; first += kThreads) {
    const uint64_t k = first + threadIdx.x;
    const uint32_t id = s.next_id + static_cast<uint32_t>(k);
    const uint64_t target = k < s.births ? target_of(s, a, id) : kNoTarget;
    uint32_t here;
    const uint64_t place = born + sum_before<uint32_t>(target != kNoTarget ? 1u : 0u, &here);
    if (target != kNoTarget) {
      a.id[s.count + place] = id;
      add_child(memory, change->relocated + place, target, s.count + place);
    }
    born += here;
  }
  if (threadIdx.x == 0) change->born = born;
}

// The first child that comes to a target shrinks it, for all.
__global__ void __launch_bounds__(kThreads)
    shrink_targets(DensityStep s, DensityArrays a, RelocationMemory memory,
                   const DeviceDensityChange* change) {
  const uint64_t children = change->relocated + change->born;
  for (uint64_t k = uint64_t{blockIdx.x} * kThreads + threadIdx.x; k < children;
       k += uint64_t{gridDim.x} * kThreads) {
    const uint64_t target = memory.children[2 * k];
    const uint32_t copies = atomicExch(memory.copies + target, 0u);
    if (copies == 0) continue;
    const uint32_t n = copies + 1;
    shrink_target(s, a, target, static_cast<int>(n < kMaxCopies ? n : kMaxCopies));
  }
}

__global__ void __launch_bounds__(kThreads)
    place_children(DensityStep s, DensityArrays a, RelocationMemory memory,
                   const DeviceDensityChange* change) {
  const uint64_t children = change->relocated + change->born;
  for (uint64_t k = uint64_t{blockIdx.x} * kThreads + threadIdx.x; k < children;
       k += uint64_t{gridDim.x} * kThreads) {
    place_child(s, a, memory.children[2 * k], memory.children[2 * k + 1]);
  }
}

// What accumulate_weights reads.
struct WeightInput {
  const float *opacity, *coverage, *error;
  uint64_t count;
  float beta;
};
__device__ double excess(const WeightInput& in, uint64_t i) {
  return in.coverage[i] > 0 ? static_cast<double>(in.error[i] / in.coverage[i]) : 0.0;
}
__device__ double weight(const WeightInput& in, uint64_t i, double mean) {
  const double opacity = linear_opacity(static_cast<double>(in.opacity[i]), true);
  if (!isfinite(opacity) || !(opacity >= static_cast<double>(kDeadOpacity))) return 0;
  return opacity * (1 + static_cast<double>(in.beta) * (mean > 0 ? excess(in, i) / mean : 0));
}

// partial: [blocks] sums of excess, [blocks] of weights, then the mean excess.
template <bool kWeights>
__global__ void __launch_bounds__(kThreads)
    sum_rows(WeightInput in, uint32_t blocks, double* partial, double* cumulative) {
  const uint64_t i = uint64_t{blockIdx.x} * kThreads + threadIdx.x;
  double own = 0;
  if (i < in.count) own = kWeights ? weight(in, i, partial[2 * blocks]) : excess(in, i);
  double total;
  const double before = sum_before<double>(own, &total);
  if (kWeights && i < in.count) cumulative[i] = before + own;
  if (threadIdx.x == 0) partial[(kWeights ? blocks : 0) + blockIdx.x] = total;
}

// One block. Of excess: the mean. Of weights: sums before each block.
template <bool kWeights>
__global__ void __launch_bounds__(kThreads)
    sum_blocks(uint64_t count, uint32_t blocks, double* partial) {
  double all = 0;
  double* from = partial + (kWeights ? blocks : 0);
  for (uint32_t first = 0; first < blocks; first += kThreads) {
    const uint32_t b = first + threadIdx.x;
    double total;
    const double before = sum_before<double>(b < blocks ? from[b] : 0, &total);
    if (kWeights && b < blocks) from[b] = all + before;
    all += total;
  }
  if (!kWeights && threadIdx.x == 0) partial[2 * blocks] = all / static_cast<double>(count);
}

__global__ void __launch_bounds__(kThreads)
    add_sums(uint64_t count, uint32_t blocks, const double* partial, double* cumulative) {
  const uint64_t i = uint64_t{blockIdx.x} * kThreads + threadIdx.x;
  if (i < count) cumulative[i] += partial[blocks + blockIdx.x];
}

uint32_t blocks_of(uint64_t count) {
  return static_cast<uint32_t>((count + kThreads - 1) / kThreads);
}

}  // namespace

size_t weight_partial_size(uint64_t capacity) { return size_t{2} * blocks_of(capacity) + 1; }

void launch_change_density(const DensityStep& step, const DensityArrays& arrays,
                           const RelocationMemory& memory, DeviceDensityChange* change,
                           cudaStream_t stream) {
  cudaMemsetAsync(change, 0, sizeof *change, stream);
  if (step.count == 0 || arrays.sampled == 0) return;
  constexpr uint32_t kBlocks = 132;  // children are few
  find_dead<<<blocks_of(step.count), kThreads, 0, stream>>>(step, arrays, memory, change);
  add_births<<<1, kThreads, 0, stream>>>(step, arrays, memory, change);
  shrink_targets<<<kBlocks, kThreads, 0, stream>>>(step, arrays, memory, change);
  place_children<<<kBlocks, kThreads, 0, stream>>>(step, arrays, memory, change);
}

void launch_accumulate_weights(const Rows<const float>& value, const float* coverage,
                               const float* error, uint64_t count, float beta, double* partial,
                               double* cumulative, cudaStream_t stream) {
  if (count == 0) return;
  const WeightInput in{value.opacity, coverage, error, count, beta};
  const uint32_t blocks = blocks_of(count);
  sum_rows<false><<<blocks, kThreads, 0, stream>>>(in, blocks, partial, cumulative);
  sum_blocks<false><<<1, kThreads, 0, stream>>>(count, blocks, partial);
  sum_rows<true><<<blocks, kThreads, 0, stream>>>(in, blocks, partial, cumulative);
  sum_blocks<true><<<1, kThreads, 0, stream>>>(count, blocks, partial);
  add_sums<<<blocks, kThreads, 0, stream>>>(count, blocks, partial, cumulative);
}

}  // namespace l4d::train
