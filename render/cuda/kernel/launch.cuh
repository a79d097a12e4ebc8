// SPDX-License-Identifier: Apache-2.0
// Kernels that follow each other closely: the next one starts up while the one before still runs,
// and waits inside for its results.
#pragma once

#include <cuda_runtime.h>

#include "libl4dcodec/cuda/overlap.cuh"

namespace l4d::render {

// First thing in every kernel that launch() starts: what was launched before is done after it.
__device__ inline void await_predecessor() {
  cuda::let_next_begin();
  cuda::wait_for_previous();
}

// Errors stay for cudaGetLastError().
template <typename... Parameters, typename... Arguments>
void launch(void (*kernel)(Parameters...), unsigned grid, unsigned block, cudaStream_t stream,
            const Arguments&... arguments) {
  cudaLaunchAttribute overlap{};
  overlap.id = cudaLaunchAttributeProgrammaticStreamSerialization;
  overlap.val.programmaticStreamSerializationAllowed = 1;
  cudaLaunchConfig_t config{};
  config.gridDim = dim3(grid);
  config.blockDim = dim3(block);
  config.stream = stream;
  config.attrs = &overlap;
  config.numAttrs = cuda::can_overlap() ? 1 : 0;
  static_cast<void>(cudaLaunchKernelEx(&config, kernel, Parameters(arguments)...));
}

}  // namespace l4d::render
