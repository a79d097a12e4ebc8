// SPDX-License-Identifier: Apache-2.0
// What the programs that time rendering on a device share: device arrays, and runs by the device's
// clock.
#pragma once

#include <cuda_runtime_api.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "l4d/experimental/cuda_render.h"

namespace l4d::bench {

constexpr int kWarmUp = 20;

inline void check(cudaError_t error) {
  if (error == cudaSuccess) return;
  std::fprintf(stderr, "%s\n", cudaGetErrorString(error));
  std::exit(1);
}

template <typename T>
class Array {
 public:
  explicit Array(size_t n) : bytes_(n * sizeof(T)) { check(cudaMalloc(&data_, bytes_)); }
  explicit Array(const std::vector<T>& from) : Array(from.size()) {
    check(cudaMemcpy(data_, from.data(), bytes_, cudaMemcpyHostToDevice));
  }
  ~Array() { cudaFree(data_); }
  Array(const Array&) = delete;
  Array& operator=(const Array&) = delete;
  T* get() const { return static_cast<T*>(data_); }
  void clear() const { check(cudaMemset(data_, 0, bytes_)); }

 private:
  void* data_ = nullptr;
  size_t bytes_;
};

struct Timing {
  double median, p99;  // milliseconds
};

// Times run(k) for k = 0, 1, ... one by one.
template <class Run>
Timing time_runs(int runs, cudaStream_t stream, const Run& run) {
  for (int k = 0; k < kWarmUp; ++k) run(k);
  std::vector<cudaEvent_t> events(static_cast<size_t>(runs) + 1);
  for (cudaEvent_t& e : events) check(cudaEventCreate(&e));
  check(cudaEventRecord(events[0], stream));
  for (int k = 0; k < runs; ++k) {
    run(k);
    check(cudaEventRecord(events[static_cast<size_t>(k) + 1], stream));
  }
  check(cudaStreamSynchronize(stream));
  std::vector<float> ms(static_cast<size_t>(runs));
  for (size_t k = 0; k < ms.size(); ++k) {
    check(cudaEventElapsedTime(&ms[k], events[k], events[k + 1]));
  }
  for (cudaEvent_t e : events) cudaEventDestroy(e);
  std::sort(ms.begin(), ms.end());
  return {static_cast<double>(ms[ms.size() / 2]),
          static_cast<double>(ms[ms.size() - 1 - ms.size() / 100])};
}

inline void must(l4d_status status) {
  if (status == L4D_OK) return;
  std::fprintf(stderr, "%s\n", l4d_last_error_message());
  std::exit(1);
}

}  // namespace l4d::bench
