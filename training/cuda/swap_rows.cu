// SPDX-License-Identifier: Apache-2.0
#include "training/cuda/swap_rows_device.h"

namespace l4d::train {
namespace {

constexpr uint32_t kThreads = 256;
constexpr uint64_t kMostBlocks = 1u << 20;

unsigned blocks_of(uint64_t count) {
  const uint64_t blocks = (count + kThreads - 1) / kThreads;
  return static_cast<unsigned>(blocks < kMostBlocks ? blocks : kMostBlocks);
}

// A thread moves a word: neighbours read and write neighbours.
__global__ void __launch_bounds__(kThreads)
    move_rows(const uint32_t* in, const uint32_t* from, uint32_t* out, const uint32_t* to,
              uint64_t count, uint32_t words) {
  for (uint64_t at = uint64_t{blockIdx.x} * kThreads + threadIdx.x; at < count * words;
       at += uint64_t{gridDim.x} * kThreads) {
    const uint64_t k = at / words, word = at % words;
    const uint64_t source = from == nullptr ? k : from[k];
    const uint64_t target = to == nullptr ? k : to[k];
    out[target * words + word] = in[source * words + word];
  }
}

__global__ void __launch_bounds__(kThreads)
    find_spans(Rows<float> value, const uint32_t* id, uint64_t count, RowSpan* spans) {
  for (uint64_t i = uint64_t{blockIdx.x} * kThreads + threadIdx.x; i < count;
       i += uint64_t{gridDim.x} * kThreads) {
    spans[i] = span_of(value.rotor + 8 * i, value.log_scale + 4 * i, value.mean_t[i], id[i]);
  }
}

}  // namespace

void launch_move_rows(const uint32_t* in, const uint32_t* from, uint32_t* out, const uint32_t* to,
                      uint64_t count, uint32_t words, cudaStream_t stream) {
  if (count == 0) return;
  move_rows<<<blocks_of(count * words), kThreads, 0, stream>>>(in, from, out, to, count, words);
}

void launch_spans(const Rows<float>& value, const uint32_t* id, uint64_t count, RowSpan* spans,
                  cudaStream_t stream) {
  if (count == 0) return;
  find_spans<<<blocks_of(count), kThreads, 0, stream>>>(value, id, count, spans);
}

}  // namespace l4d::train
