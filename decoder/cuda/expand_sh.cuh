// SPDX-License-Identifier: Apache-2.0
// Columns to SH (spec: "Reconstruction"), in the order of operations of decoder/expand/expand.cc. A
// block of kExpandThreads threads takes an ExpandTask.
#pragma once

#include "decoder/cuda/components.cuh"

namespace l4d::cuda {

// Working memory of expand_sh_transform.
template <unsigned kDim>
struct alignas(16) TransformShared {
  static constexpr uint32_t kLanes = 8;                               // beside each other in a row
  static constexpr uint32_t kNumbers = (kDim + kLanes - 1) / kLanes;  // of a row, a thread
  static constexpr uint32_t kWidth = kLanes * kNumbers;
  static constexpr uint32_t kChunk = 16;  // coefficients of a row that are there at a time
  static constexpr uint32_t kRows = 4;    // a thread
  static constexpr uint32_t kWarpRows = 32 / kLanes * kRows;
  static constexpr uint32_t kWarps = kExpandThreads / 32;
  static constexpr uint32_t kCodes = kChunk * kWarpRows / 32;  // that a thread brings of a chunk
  static_assert(kWarps * kWarpRows * 2 == kExpandGaussians, "two rounds");
  static_assert(kMaxCoefficients % kChunk == 0, "whole chunks");

  int chunk[kWarps][2][kChunk][kWarpRows];
  int basis[kMaxCoefficients * kWidth];
  uint32_t begin[kMaxCoefficients + 2];
  uint16_t order[kExpandGaussians];  // number of coefficients, Gaussian of the block
};

// shared.order: Gaussians of the block by falling number of coefficients.
template <unsigned kDim>
__device__ void order_by_coefficients(const ComponentSource& source, const ExpandBlock& block,
                                      TransformShared<kDim>& shared) {
  const uint32_t t = threadIdx.x;
  if (t < kMaxCoefficients + 2) shared.begin[t] = 0;
  __syncthreads();
  // begin[m + 1] counts those with the m-th largest number of coefficients, kMaxCoefficients first.
  const uint32_t own = t < block.count ? source.coefficients(block.slot(t)) : 0;
  const uint32_t rank = kMaxCoefficients - own;
  uint32_t among = 0;
  if (t < block.count) among = atomicAdd(&shared.begin[rank + 1], 1u);
  __syncthreads();
  if (t < 32) {
    // Two numbers a lane.
    static_assert(kMaxCoefficients + 2 <= 64 && kMaxCoefficients % 2 == 0, "two numbers a lane");
    const bool has = 2 * t < kMaxCoefficients + 2;
    const uint32_t b = has ? shared.begin[2 * t + 1] : 0;
    uint32_t sum = has ? shared.begin[2 * t] + b : 0;
    for (uint32_t step = 1; step < 32; step *= 2) {
      const uint32_t before = __shfl_up_sync(0xffffffffu, sum, step);
      if (t >= step) sum += before;
    }
    if (has) {
      shared.begin[2 * t] = sum - b;
      shared.begin[2 * t + 1] = sum;
    }
  }
  __syncthreads();
  if (t < block.count) {
    shared.order[shared.begin[rank] + among] = static_cast<uint16_t>(own << 8 | t);
  }
  __syncthreads();
}

// Rows [first_row, first_row + kWarpRows) of the order, by a warp. A thread has a tile of kRows
// times kNumbers of their numbers in registers, so that what it loads is used several times.
template <unsigned kDim>
__device__ void expand_sh_tile(const ComponentSource& source, const ExpandBlock& block,
                               const DeviceArrays& out, uint32_t first_row,
                               TransformShared<kDim>& shared) {
  using Shared = TransformShared<kDim>;
  __syncwarp();  // the chunks of the tile before have been read
  const uint32_t lane = threadIdx.x % 32;
  // The row of which this thread brings coefficients, and which of a chunk.
  const uint32_t place = first_row + lane % Shared::kWarpRows;
  const uint32_t offset = lane / Shared::kWarpRows * Shared::kCodes;
  const uint32_t own = place < block.count ? shared.order[place] : 0;
  const uint32_t count = own >> 8;
  const uint32_t most = __shfl_sync(0xffffffffu, count, 0);
  const size_t own_slot = block.slot(own & 0xff);
  const uint16_t* codes = source.value + own_slot;
  uint32_t code[Shared::kCodes];
  const auto load = [&](uint32_t first) {
#pragma unroll
    for (uint32_t j = 0; j < Shared::kCodes; ++j) {
      const uint32_t k = first + offset + j;
      code[j] = k < count ? codes[k * source.stride] : uint16_t{0};
    }
  };
  load(0);
  const uint32_t column = lane % Shared::kLanes, group = lane / Shared::kLanes * Shared::kRows;
  uint32_t sum[Shared::kRows][Shared::kNumbers] = {};
  for (uint32_t first = 0; first < most; first += Shared::kChunk) {
    auto& chunk = shared.chunk[threadIdx.x / 32][first / Shared::kChunk % 2];
#pragma unroll
    for (uint32_t j = 0; j < Shared::kCodes; ++j) {
      chunk[offset + j][lane % Shared::kWarpRows] = unzigzag(code[j]);
    }
    if (first + Shared::kChunk < most) load(first + Shared::kChunk);
    __syncwarp();
    const int* basis = shared.basis + first * Shared::kWidth + column;
    const uint32_t there = min(Shared::kChunk, most - first);
#pragma unroll 4
    for (uint32_t j = 0; j < there; ++j) {
      static_assert(Shared::kRows == 4, "four numbers are loaded");
      const int4 four = *reinterpret_cast<const int4*>(&chunk[j][group]);
      const int q[4] = {four.x, four.y, four.z, four.w};
#pragma unroll
      for (uint32_t m = 0; m < Shared::kNumbers; ++m) {
        const int number = basis[j * Shared::kWidth + Shared::kLanes * m];
#pragma unroll
        for (uint32_t r = 0; r < Shared::kRows; ++r) {
          sum[r][m] += static_cast<uint32_t>(q[r] * number);
        }
      }
    }
  }
#pragma unroll
  for (uint32_t r = 0; r < Shared::kRows; ++r) {
    if (first_row + group + r >= block.count) break;
    const uint32_t row = shared.order[first_row + group + r];
    const float scale = source.coding.integer_scale * source.step_scale(block.slot(row & 0xff));
    float* to = out.sh + size_t{kDim} * block.gaussian(row & 0xff) + column;
#pragma unroll
    for (uint32_t m = 0; m < Shared::kNumbers; ++m) {
      const uint32_t d = column + Shared::kLanes * m;
      if (d >= kDim) break;
      to[Shared::kLanes * m] =
          source.codebook0[d] + static_cast<float>(static_cast<int>(sum[r][m])) * scale;
    }
  }
}

// SH of a page without any channel of SH: the first vector of the basis (DEC-7), bit by bit. A sum
// with no coefficients would lose the sign of -0.
template <unsigned kDim>
__device__ void copy_sh_base(const ComponentSource& source, const ExpandBlock& block,
                             const DeviceArrays& out) {
  for (uint32_t e = threadIdx.x; e < block.count * kDim; e += kExpandThreads) {
    const uint32_t i = e / kDim, d = e % kDim;
    out.sh[size_t{kDim} * block.gaussian(i) + d] = source.codebook0[d];
  }
}

// SH of transform coefficients: rows of coefficients times the basis, a product of matrices of
// integers. Gaussians are taken by falling number of coefficients, so that those of a warp have
// about as many; zeros behind those that a row has change nothing.
template <unsigned kDim>
__device__ void expand_sh_transform(const DeviceRequest& request, const DeviceArrays& out,
                                    uint32_t index, TransformShared<kDim>& shared) {
  using Shared = TransformShared<kDim>;
  const ExpandBlock block(request, index);
  if (block.count == 0) return;
  const ComponentSource source(request, block, L4D_COMPONENT_SH);
  if (block.page->has_sh == 0) {
    copy_sh_base<kDim>(source, block, out);
    return;
  }
  const uint32_t t = threadIdx.x;
  const uint32_t coded = min(source.coding.num_coefficients, source.limit);
  for (uint32_t e = t; e < kMaxCoefficients * Shared::kWidth; e += kExpandThreads) {
    const uint32_t k = e / Shared::kWidth, d = e % Shared::kWidth;
    shared.basis[e] = k < coded && d < kDim ? source.coding.integer_basis[kDim * k + d] : 0;
  }
  order_by_coefficients(source, block, shared);

  for (uint32_t round = 0; round < 2; ++round) {
    const uint32_t first_row = (round * Shared::kWarps + t / 32) * Shared::kWarpRows;
    if (first_row < block.count) expand_sh_tile(source, block, out, first_row, shared);
  }
}

// SH of codebooks, or zeros: a thread for each kWidth numbers of a row, so that rows are read and
// written whole.
template <unsigned kDim, unsigned kWidth>
__device__ void expand_sh_rows(const DeviceRequest& request, const DeviceArrays& out,
                               uint32_t index) {
  static_assert(kDim % kWidth == 0 && (kWidth == 1 || kWidth == 4), "rows are cut evenly");
  constexpr uint32_t kPieces = kDim / kWidth;
  const ExpandBlock block(request, index);
  const ComponentSource source(request, block, L4D_COMPONENT_SH);
  const bool zero = source.is(ComponentCodingId::kZero) || block.page->has_sh == 0;
  for (uint32_t e = threadIdx.x; e < block.count * kPieces; e += kExpandThreads) {
    const uint32_t i = e / kPieces, first = e % kPieces * kWidth;
    const size_t slot = block.slot(i);
    const uint32_t depth = zero ? 0 : source.depth(slot);
    float row[kWidth] = {};
    if (depth == kEscapeDepth || kWidth == 1) {
      for (unsigned d = 0; d < kWidth; ++d) {
        row[d] = vq_number(source, slot, depth, kDim, first + d);
      }
    } else {
      for (uint32_t s = 0; s < depth; ++s) {
        const uint32_t index = source.value[s * source.stride + slot];
        const float4 v =
            *reinterpret_cast<const float4*>(source.codebook(s) + size_t{index} * kDim + first);
        const float numbers[4] = {v.x, v.y, v.z, v.w};
        for (unsigned d = 0; d < kWidth; ++d) row[d] = s == 0 ? numbers[d] : row[d] + numbers[d];
      }
    }
    float* to = out.sh + size_t{kDim} * block.gaussian(i) + first;
    if (kWidth == 4) {
      store4(to, row[0], row[1 % kWidth], row[2 % kWidth], row[3 % kWidth]);
    } else {
      to[0] = row[0];
    }
  }
}

}  // namespace l4d::cuda
