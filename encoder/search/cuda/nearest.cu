// SPDX-License-Identifier: Apache-2.0
// The search for the nearest codeword on a device: every pair, in the order of operations of the
// host's search (encoder/search/nearest_simd.cc), so that labels and distances are the same to the
// last bit. All of it is fused: no distance but the least one of a point leaves a register.
#include <math_constants.h>

#include "encoder/search/cuda/nearest_kernels.h"

namespace l4d::cuda {
namespace {

constexpr int kThreads = 128;
constexpr int kLanes = 8;            // partial sums of the host's vectors
constexpr int kMaxPlainDim = 8;      // up to here it sums one number after the other
constexpr int kSharedFloats = 8192;  // of codewords, at a time

template <int kDim>
__device__ float squared_distance(const float* p, const float* c) {
  if constexpr (kDim <= kMaxPlainDim) {
    float sum = 0;
#pragma unroll
    for (int j = 0; j < kDim; ++j) {
      const float e = __fsub_rn(c[j], p[j]);
      sum = __fmaf_rn(e, e, sum);
    }
    return sum;
  } else {
    constexpr int kWhole = kDim / kLanes * kLanes;
    float sum[kLanes] = {};
#pragma unroll
    for (int j = 0; j < kWhole; ++j) {
      const float e = __fsub_rn(p[j], c[j]);
      sum[j % kLanes] = __fmaf_rn(e, e, sum[j % kLanes]);
    }
    float rest = 0;
#pragma unroll
    for (int j = kWhole; j < kDim; ++j) {
      const float e = __fsub_rn(p[j], c[j]);
      rest = __fadd_rn(rest, __fmul_rn(e, e));
    }
    const float even = __fadd_rn(__fadd_rn(sum[0], sum[4]), __fadd_rn(sum[2], sum[6]));
    const float odd = __fadd_rn(__fadd_rn(sum[1], sum[5]), __fadd_rn(sum[3], sum[7]));
    return __fadd_rn(__fadd_rn(even, odd), rest);
  }
}

// A thread has a point in registers; the codewords come through shared memory, where all threads of
// a warp read the same one.
template <int kDim>
__global__ void __launch_bounds__(kThreads)
    nearest_kernel(const float* __restrict__ points, size_t n, const float* __restrict__ codebook,
                   uint32_t k, uint32_t first_label, bool keep, uint32_t* __restrict__ labels,
                   float* __restrict__ sq_dist) {
  // A row of vectors of four begins where one may be read.
  constexpr int kStride = (kDim + 3) / 4 * 4;
  constexpr uint32_t kTile = kSharedFloats / kStride;
  __shared__ __align__(16) float tile[kTile * kStride];
  const size_t i = size_t{blockIdx.x} * kThreads + threadIdx.x;
  const bool active = i < n;
  float p[kDim];
#pragma unroll
  for (int j = 0; j < kDim; ++j) p[j] = active ? points[i * kDim + j] : 0.0f;
  // What is known wins ties; else the lowest codeword does, as they come in order.
  float best = keep && active ? sq_dist[i] : CUDART_INF_F;
  uint32_t label = keep && active ? labels[i] : first_label;
  for (uint32_t begin = 0; begin < k; begin += kTile) {
    const uint32_t count = min(kTile, k - begin);
    __syncthreads();
    for (uint32_t at = threadIdx.x; at < count * kDim; at += kThreads) {
      tile[at / kDim * kStride + at % kDim] = codebook[size_t{begin} * kDim + at];
    }
    __syncthreads();
    for (uint32_t e = 0; e < count; ++e) {
      float c[kStride];
#pragma unroll
      for (int j = 0; j < kStride; j += 4) {
        const float4 four = *reinterpret_cast<const float4*>(tile + e * kStride + j);
        c[j] = four.x;
        c[j + 1] = four.y;
        c[j + 2] = four.z;
        c[j + 3] = four.w;
      }
      const float distance = squared_distance<kDim>(p, c);
      if (distance < best) {
        best = distance;
        label = first_label + begin + e;
      }
    }
  }
  if (!active) return;
  labels[i] = label;
  sq_dist[i] = best;
}

using Kernel = void (*)(const float*, size_t, const float*, uint32_t, uint32_t, bool, uint32_t*,
                        float*);

Kernel kernel_for(size_t dim) {
  switch (dim) {
    case 3:
      return nearest_kernel<3>;
    case 4:
      return nearest_kernel<4>;
    case 12:
      return nearest_kernel<12>;
    case 27:
      return nearest_kernel<27>;
    case 48:
      return nearest_kernel<48>;
    default:
      return nullptr;
  }
}

}  // namespace

bool nearest_has_kernel(size_t dim) { return kernel_for(dim) != nullptr; }

cudaError_t launch_nearest(const float* points, size_t n, size_t dim, const float* codebook,
                           size_t k, uint32_t first_label, bool keep, uint32_t* labels,
                           float* sq_dist, cudaStream_t stream) {
  const Kernel kernel = kernel_for(dim);
  if (kernel == nullptr) return cudaErrorInvalidValue;
  const unsigned blocks = static_cast<unsigned>((n + kThreads - 1) / kThreads);
  kernel<<<blocks, kThreads, 0, stream>>>(points, n, codebook, static_cast<uint32_t>(k),
                                          first_label, keep, labels, sq_dist);
  return cudaGetLastError();
}

}  // namespace l4d::cuda
