// SPDX-License-Identifier: Apache-2.0
// Decoding on a device in one call, into arrays that were poisoned before.
#pragma once

#include <cuda_runtime_api.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <ostream>
#include <stdexcept>
#include <string>
#include <vector>

#include "l4d/cuda.h"
#include "l4d/l4d.hpp"
#include "libl4dcodec/base/bytes.h"
#include "tests/common/test_scene.h"
#include "tests/gpu/device.h"

namespace l4d::test {

inline void cuda_check(cudaError_t error) {
  if (error != cudaSuccess) throw std::runtime_error(cudaGetErrorString(error));
}

// A stream whose components have codebooks of blocks, with a permanent layer.
Bytes block_codebooks_file(bool rans);

// Flat windows of 1 to `longest` frames for two of three Gaussians.
TestScene windowed_scene(const SceneOptions& options, uint32_t longest);

// Status, clause and offset of a failure; messages may say more on the host.
struct Verdict {
  l4d_status status = L4D_OK;
  std::string where;
  bool operator==(const Verdict& other) const {
    return status == other.status && where == other.where;
  }
};
std::ostream& operator<<(std::ostream& out, const Verdict& v);
Verdict verdict(l4d_status status, const std::string& detail);

// Device memory; every byte is kPoison at first.
class PoisonedMemory {
 public:
  static constexpr int kPoison = 0xb5;
  explicit PoisonedMemory(size_t bytes) : bytes_(bytes) {
    cuda_check(cudaMalloc(&data_, bytes + kGuard));
    cuda_check(cudaMemset(data_, kPoison, bytes + kGuard));
  }
  ~PoisonedMemory() { cudaFree(data_); }
  PoisonedMemory(const PoisonedMemory&) = delete;
  PoisonedMemory& operator=(const PoisonedMemory&) = delete;

  void* data() const { return data_; }
  float* floats() const { return static_cast<float*>(data_); }
  uint32_t* words() const { return static_cast<uint32_t*>(data_); }
  size_t bytes() const { return bytes_; }
  std::vector<float> read() const;
  std::vector<uint32_t> read_words() const;
  // Whether what lies behind still is as it was.
  bool is_intact_behind() const;

 private:
  static constexpr size_t kGuard = 4096;
  void* data_ = nullptr;
  size_t bytes_ = 0;
};

struct DeviceResult {
  l4d_status status = L4D_OK;  // of the first call that failed
  std::string detail;
  l4d_cuda_request request{};
  GaussianArrays arrays;  // the requested ones, as the device left them
};

class DeviceDecoding {
 public:
  // Throws l4d::Error where the device decoder cannot be had.
  explicit DeviceDecoding(DecoderHandle& decoder);
  ~DeviceDecoding() { l4d_cuda_decoder_destroy(cuda_); }
  DeviceDecoding(const DeviceDecoding&) = delete;
  DeviceDecoding& operator=(const DeviceDecoding&) = delete;

  l4d_cuda_decoder* get() const { return cuda_; }
  // attributes: L4D_CUDA_*, of the request and of the arrays.
  DeviceResult decode(const l4d_query& query, uint32_t attributes = L4D_CUDA_ALL_ATTRIBUTES);

 private:
  DecoderHandle& decoder_;
  l4d_cuda_decoder* cuda_ = nullptr;
  uint32_t sh_dim_ = 0;
};

DeviceResult decode_on_device(const Bytes& bytes, const l4d_query& query,
                              uint32_t attributes = L4D_CUDA_ALL_ATTRIBUTES);

// Leaves the attributes asked for, as a decoder that gets NULL for the others.
GaussianArrays only(GaussianArrays arrays, uint32_t attributes);

// The same bits as the reference on the host, and the same spans.
void expect_as_on_host(const Bytes& bytes, const l4d_query& query,
                       uint32_t attributes = L4D_CUDA_ALL_ATTRIBUTES);
void expect_as_on_host_for_all_queries(const Bytes& bytes);

}  // namespace l4d::test
