// SPDX-License-Identifier: Apache-2.0
#include "decoder/cuda/kernels.h"
#include "decoder/cuda/pack.cuh"

namespace l4d::cuda {
namespace {

constexpr unsigned kCopyBlocks = 64;

__global__ void __launch_bounds__(kPackThreads)
    pack_kernel(const DeviceJob job, const PackedArrays out) {
  if (blockIdx.x < job.num_expands) {
    pack_rows(job, out, blockIdx.x);
  } else {
    count_host_piece(job, out, blockIdx.x - job.num_expands);
  }
}

__global__ void __launch_bounds__(kSumThreads) sum_kernel(const DeviceJob job) {
  __shared__ LiteralSum of_warps[kSumThreads / 32];
  sum_literals(job, of_warps);
}

__global__ void __launch_bounds__(kPackThreads)
    gather_kernel(const DeviceJob job, const PackedArrays out) {
  __shared__ uint32_t of_warps[kPackWarps];
  gather_literals(job, out, blockIdx.x, of_warps);
}

__global__ void __launch_bounds__(kPackThreads)
    copy_kernel(const DeviceJob job, const PackedArrays out) {
  copy_literals(job, out, blockIdx.x);
}

}  // namespace

cudaError_t launch_pack(const DeviceJob& job, const PackedArrays& out, cudaStream_t stream) {
  const uint32_t blocks = job.num_expands + job.num_host_pieces;
  if (blocks == 0) return cudaSuccess;
  pack_kernel<<<blocks, kPackThreads, 0, stream>>>(job, out);
  if (job.num_pieces == 0) return cudaGetLastError();
  sum_kernel<<<L4D_COMPONENT_COUNT, kSumThreads, 0, stream>>>(job);
  bool literals = false;
  for (const PackedArrays::Component& c : out.component) literals |= c.literal != nullptr;
  if (literals && job.num_expands > 0) {
    gather_kernel<<<job.num_expands, kPackThreads, 0, stream>>>(job, out);
  }
  if (literals && job.num_host_pieces > 0) {
    const dim3 grid(job.num_host_pieces, kCopyBlocks);
    copy_kernel<<<grid, kPackThreads, 0, stream>>>(job, out);
  }
  return cudaGetLastError();
}

}  // namespace l4d::cuda
