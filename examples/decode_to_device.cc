// SPDX-License-Identifier: Apache-2.0
// Decodes all Gaussians of a stream into arrays on a CUDA device, as decode_to_device.c does. Exit
// status 77: there is no device.
//
//   decode_to_device SCENE.l4d
//   c++ -std=c++17 decode_to_device.cc $(pkg-config --cflags --libs l4dcodec) -lcudart
#include <cuda_runtime_api.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <memory>
#include <new>

#include "l4d/cuda.hpp"

namespace {

struct Free {
  void operator()(void* memory) const noexcept { cudaFree(memory); }
};
using DeviceMemory = std::unique_ptr<void, Free>;

DeviceMemory room(uint64_t bytes) {
  void* memory = nullptr;
  if (cudaMalloc(&memory, std::max<uint64_t>(bytes, 1)) != cudaSuccess) throw std::bad_alloc();
  return DeviceMemory(memory);
}

void decode(const char* path) {
  l4d::DecoderHandle decoder;
  decoder.open_file(path);
  l4d::CudaDecoderHandle on_device(decoder);

  const l4d_query all = L4D_INIT(l4d_query);
  l4d_cuda_request request = L4D_INIT(l4d_cuda_request);
  request.attributes = L4D_CUDA_POSITION | L4D_CUDA_OPACITY;
  on_device.prepare(all, &request);
  const DeviceMemory position = room(3 * sizeof(float) * request.num_gaussians);
  const DeviceMemory opacity = room(sizeof(float) * request.num_gaussians);
  const DeviceMemory workspace = room(request.workspace_bytes);
  l4d_cuda_gaussian_buffers arrays = L4D_INIT(l4d_cuda_gaussian_buffers);
  arrays.capacity = request.num_gaussians;
  arrays.position = static_cast<float*>(position.get());
  arrays.opacity = static_cast<float*>(opacity.get());
  on_device.decode(arrays, workspace.get(), request.workspace_bytes);
  on_device.finish();

  std::array<float, 3> first{};
  if (request.num_gaussians > 0) {
    cudaMemcpy(first.data(), position.get(), sizeof first, cudaMemcpyDeviceToHost);
  }
  std::printf("%llu Gaussians, %llu bytes sent to the device; the first is at %g %g %g\n",
              static_cast<unsigned long long>(request.num_gaussians),
              static_cast<unsigned long long>(request.upload_bytes), static_cast<double>(first[0]),
              static_cast<double>(first[1]), static_cast<double>(first[2]));
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: decode_to_device SCENE.l4d\n");
    return 2;
  }
  if (l4d::cuda_devices().empty()) {
    std::fprintf(stderr, "decode_to_device: no CUDA device\n");
    return 77;
  }
  try {
    decode(argv[1]);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "decode_to_device: %s\n", error.what());
    return 1;
  }
}
