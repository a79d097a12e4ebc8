// SPDX-License-Identifier: Apache-2.0
#include "decoder/cuda/kernels.h"
#include "decoder/cuda/pack.cuh"

namespace l4d::cuda {
namespace {

constexpr unsigned kCopyBlocks = 64;

__global__ void __launch_bounds__(kPackThreads)
    pack_kernel(const DeviceRequest request, const PackedArrays out) {
  if (blockIdx.x < request.num_expands) {
    pack_rows(request, out, blockIdx.x);
  } else {
    count_host_piece(request, out, blockIdx.x - request.num_expands);
  }
}

__global__ void __launch_bounds__(kSumThreads) sum_kernel(const DeviceRequest request) {
  __shared__ EscapeSum of_warps[kSumThreads / 32];
  sum_escapes(request, of_warps);
}

__global__ void __launch_bounds__(kPackThreads)
    gather_kernel(const DeviceRequest request, const PackedArrays out) {
  __shared__ uint32_t of_warps[kPackWarps];
  gather_escapes(request, out, blockIdx.x, of_warps);
}

__global__ void __launch_bounds__(kPackThreads)
    copy_kernel(const DeviceRequest request, const PackedArrays out) {
  copy_escapes(request, out, blockIdx.x);
}

}  // namespace

cudaError_t launch_pack(const DeviceRequest& request, const PackedArrays& out,
                        cudaStream_t stream) {
  const uint32_t blocks = request.num_expands + request.num_host_pieces;
  if (blocks == 0) return cudaSuccess;
  pack_kernel<<<blocks, kPackThreads, 0, stream>>>(request, out);
  if (request.num_pieces == 0) return cudaGetLastError();
  sum_kernel<<<L4D_COMPONENT_COUNT, kSumThreads, 0, stream>>>(request);
  bool escapes = false;
  for (const PackedArrays::Component& c : out.component) escapes |= c.escape != nullptr;
  if (escapes && request.num_expands > 0) {
    gather_kernel<<<request.num_expands, kPackThreads, 0, stream>>>(request, out);
  }
  if (escapes && request.num_host_pieces > 0) {
    const dim3 grid(request.num_host_pieces, kCopyBlocks);
    copy_kernel<<<grid, kPackThreads, 0, stream>>>(request, out);
  }
  return cudaGetLastError();
}

}  // namespace l4d::cuda
