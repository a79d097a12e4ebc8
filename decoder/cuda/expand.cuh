// SPDX-License-Identifier: Apache-2.0
// Columns to float attributes on the device (spec: "Reconstruction"): the operations of
// decoder/expand.cc and of the reference loops, in the same order. A block of kExpandThreads
// threads takes the geometry or the SH of an ExpandTask.
#pragma once

#include "decoder/cuda/device_types.h"
#include "decoder/cuda/values.cuh"
#include "libl4dcodec/base/half.h"
#include "libl4dcodec/math/rotor.h"

namespace l4d::cuda {

// One for each Gaussian.
constexpr uint32_t kExpandThreads = kExpandGaussians;
static_assert(kExpandGaussians <= 256, "eight bits tell a Gaussian of a block");

// What the threads of a block have in common.
struct ExpandBlock {
  const DevicePage* page;
  const DeviceLayer* layer;
  uint32_t first;  // Gaussian of the page
  uint32_t count;

  __device__ ExpandBlock(const DeviceJob& job, uint32_t index) {
    const ExpandTask task = job.expands[index];
    page = &job.pages[task.page];
    layer = &job.layers[page->layer];
    first = task.first;
    count = min(page->n - first, kExpandGaussians);
    // Columns of damaged pages hold anything.
    if ((job.faults[2 * task.page] | job.faults[2 * task.page + 1]) != kPageOk) count = 0;
  }
  __device__ size_t slot(uint32_t i) const { return size_t{page->slot} + first + i; }
  __device__ size_t gaussian(uint32_t i) const { return page->first + first + i; }
};

// One component of the pages of a layer.
struct ComponentSource {
  const DeviceComponent& coding;
  const uint8_t* head;
  const uint8_t* rung;
  const uint16_t* value;
  size_t stride;
  const float* book0;
  uint32_t limit;  // coefficients that count

  __device__ ComponentSource(const DeviceJob& job, const ExpandBlock& block, unsigned c)
      : coding(block.layer->component[c]),
        head(job.columns.component[c].head),
        rung(job.columns.component[c].rung),
        value(job.columns.component[c].value),
        stride(job.columns.stride),
        book0(block.page->book[c] == kNoBook
                  ? coding.book[0]
                  : reinterpret_cast<const float*>(job.upload + block.page->book[c])),
        limit(c == L4D_COMPONENT_SH ? block.page->sh_limit : kMaxCoefficients) {}

  __device__ bool is(ComponentCodingId id) const {
    return coding.coding == static_cast<uint32_t>(id);
  }
  __device__ const float* book(unsigned stage) const {
    return stage == 0 ? book0 : coding.book[stage];
  }
  __device__ uint32_t depth(size_t slot) const {
    return coding.has_depth != 0 ? head[slot] : coding.num_stages;
  }
  __device__ uint32_t coefficients(size_t slot) const {
    if (limit == 0) return 0;
    if (coding.num_rungs <= 1) return min(coding.num_coefficients, limit);
    const uint32_t r = rung[slot];
    return r == 0 ? 0 : min(uint32_t{coding.ladder[r - 1]}, limit);
  }
  // c_k of the synthesis, from a zigzag code.
  __device__ static float coefficient(uint32_t code, float scale, float step) {
    return (static_cast<float>(unzigzag(code)) * scale) * step;
  }
  __device__ float class_scale(size_t slot) const {
    return 1.0f / static_cast<float>(1u << head[slot]);
  }
};

// One number of the row of a component in codebooks.
__device__ inline float vq_number(const ComponentSource& source, size_t slot, uint32_t depth,
                                  uint32_t dim, uint32_t k) {
  if (depth == kLiteralDepth) {
    return half_to_float(source.value[(source.coding.num_stages + k) * source.stride + slot]);
  }
  float sum = 0.0f;
  for (uint32_t s = 0; s < depth; ++s) {
    const uint32_t index = source.value[s * source.stride + slot];
    const float number = source.book(s)[size_t{index} * dim + k];
    sum = s == 0 ? number : sum + number;
  }
  return sum;
}

// The row of a component of a few numbers.
template <unsigned kDim>
__device__ void component_row(const ComponentSource& source, size_t slot, float* row) {
  if (source.is(ComponentCodingId::kTransform)) {
    for (unsigned d = 0; d < kDim; ++d) row[d] = source.book0[d];
    const uint32_t count = source.coefficients(slot);
    const float scale = source.class_scale(slot);
    const auto code = [&](uint32_t k) {
      return k < count ? source.value[k * source.stride + slot] : uint16_t{0};
    };
    const auto add = [&](uint32_t k, uint32_t coded) {
      const float c = source.coefficient(coded, scale, source.coding.steps[k]);
      for (unsigned d = 0; d < kDim; ++d) row[d] = row[d] + c * source.book0[kDim * (k + 1) + d];
    };
    // There are rarely more than numbers: those are asked for all at once.
    uint16_t first[kDim];
#pragma unroll
    for (unsigned k = 0; k < kDim; ++k) first[k] = code(k);
#pragma unroll
    for (unsigned k = 0; k < kDim; ++k) {
      if (k < count) add(k, first[k]);
    }
    for (uint32_t k = kDim; k < count; ++k) add(k, code(k));
    return;
  }
  const bool zero = source.is(ComponentCodingId::kZero);
  const uint32_t depth = zero ? 0 : source.depth(slot);
  for (unsigned d = 0; d < kDim; ++d) {
    row[d] = zero ? 0.0f : vq_number(source, slot, depth, kDim, d);
  }
}

__device__ inline float scalar(const DeviceScalar& coding, const uint16_t* codes, size_t slot) {
  if (coding.is_coded == 0) return coding.offset;
  return coding.offset + coding.step * static_cast<float>(codes[slot]);
}

__device__ inline void store4(float* to, float a, float b, float c, float d) {
  *reinterpret_cast<float4*>(to) = make_float4(a, b, c, d);
}

__device__ inline void expand_scale(const DeviceJob& job, const ExpandBlock& block, size_t slot,
                                    float* to) {
  const DeviceLayer& layer = *block.layer;
  const ComponentSource source(job, block, L4D_COMPONENT_SCALE);
  float row[4] = {0.0f, 0.0f, 0.0f, 0.0f};
  if (layer.permanent != 0) {
    component_row<3>(source, slot, row);
  } else {
    component_row<4>(source, slot, row);
  }
  const float factor = scalar(layer.scale_factor, job.columns.scale_factor, slot);
  for (float& number : row) number = factor + number;
  store4(to, row[0], row[1], row[2], layer.permanent != 0 ? layer.log_scale_t : row[3]);
}

__device__ inline void expand_rotor(const DeviceJob& job, const ExpandBlock& block, size_t slot,
                                    float* to) {
  const ComponentSource spatial(job, block, L4D_COMPONENT_ROTOR_SPATIAL);
  const ComponentSource temporal(job, block, L4D_COMPONENT_ROTOR_TEMPORAL);
  float rotor[8];
  if (block.layer->stereographic != 0) {
    float u[3], v[3] = {0.0f, 0.0f, 0.0f}, a[3], b[3];
    component_row<3>(spatial, slot, u);
    if (temporal.is(ComponentCodingId::kTransform)) component_row<3>(temporal, slot, v);
    for (unsigned k = 0; k < 3; ++k) {
      a[k] = on_stereographic_grid(u[k] + v[k]);
      b[k] = on_stereographic_grid(u[k] - v[k]);
    }
    RotorHalves<float> halves;
    half_of_stereographic(a, halves.a);
    half_of_stereographic(b, halves.b);
    rotor_of_halves(halves, rotor);
  } else {
    float coded[8];
    component_row<4>(spatial, slot, coded);
    component_row<4>(temporal, slot, coded + 4);
    normalize_rotor(coded, rotor);
  }
  store4(to, rotor[0], rotor[1], rotor[2], rotor[3]);
  store4(to + 4, rotor[4], rotor[5], rotor[6], rotor[7]);
}

__device__ inline void expand_position(const DeviceLayer& layer, uint64_t code, float* to) {
  for (unsigned axis = 0; axis < 3; ++axis) {
    const uint32_t coded = morton_axis(code >> axis);
    const float number = layer.position_fixed != 0 ? static_cast<float>(coded)
                                                   : half_to_float(unordered_half(coded));
    to[axis] = layer.position_center[axis] + layer.position_scale * number;
  }
}

// All attributes of Gaussian i of a block but SH and rotor.
__device__ inline void expand_place(const DeviceJob& job, const ExpandBlock& block,
                                    const DeviceArrays& out, uint32_t i) {
  const DeviceLayer& layer = *block.layer;
  const size_t slot = block.slot(i), gaussian = block.gaussian(i);
  if (out.position != nullptr) {
    expand_position(layer, job.columns.morton[slot], out.position + 3 * gaussian);
  }
  if (out.mean_t != nullptr || out.mean_t_local != nullptr) {
    const float local = layer.mean_t_coded != 0
                            ? block.page->width * half_to_float(job.columns.mean_t[slot])
                            : 0.0f;
    if (out.mean_t_local != nullptr) out.mean_t_local[gaussian] = local;
    if (out.mean_t != nullptr) {
      out.mean_t[gaussian] = static_cast<float>(block.page->center + static_cast<double>(local));
    }
  }
  if (out.opacity != nullptr) {
    out.opacity[gaussian] = scalar(layer.opacity, job.columns.opacity, slot);
  }
  if (out.log_scale != nullptr) expand_scale(job, block, slot, out.log_scale + 4 * gaussian);
}

// All attributes but SH. Rotors are half of the work: threads take them apart from the rest.
__device__ inline void expand_geometry(const DeviceJob& job, const DeviceArrays& out,
                                       uint32_t index) {
  static_assert(kExpandGaussians % 32 == 0, "a warp does one thing");
  const ExpandBlock block(job, index);
  for (uint32_t e = threadIdx.x; e < 2 * kExpandGaussians; e += kExpandThreads) {
    const uint32_t i = e % kExpandGaussians;
    if (i >= block.count) continue;
    if (e < kExpandGaussians) {
      expand_place(job, block, out, i);
    } else if (out.rotor != nullptr) {
      expand_rotor(job, block, block.slot(i), out.rotor + 8 * block.gaussian(i));
    }
  }
}

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

  float chunk[kWarps][2][kChunk][kWarpRows];
  float basis[kMaxCoefficients * kWidth];
  float steps[kMaxCoefficients];
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

// Number d of a row as the sum of exactly those terms that it has.
__device__ inline float sum_of_terms(const ComponentSource& source, size_t slot, uint32_t count,
                                     uint32_t dim, uint32_t d) {
  const float scale = source.class_scale(slot);
  float sum = source.book0[d];
  for (uint32_t k = 0; k < count; ++k) {
    const float c =
        source.coefficient(source.value[k * source.stride + slot], scale, source.coding.steps[k]);
    sum = sum + c * source.book0[dim * (k + 1) + d];
  }
  return sum;
}

// Rows [first_row, first_row + kWarpRows) of the order, by a warp. A thread has a tile of kRows
// times kNumbers of their numbers in registers, so that what it loads is used several times.
template <unsigned kDim>
__device__ void expand_sh_tile(const ComponentSource& source, const ExpandBlock& block,
                               const DeviceArrays& out, uint32_t first_row,
                               TransformShared<kDim>& shared) {
  using Shared = TransformShared<kDim>;
  const uint32_t lane = threadIdx.x % 32;
  // The row of which this thread brings coefficients, and which of a chunk.
  const uint32_t place = first_row + lane % Shared::kWarpRows;
  const uint32_t offset = lane / Shared::kWarpRows * Shared::kCodes;
  const uint32_t own = place < block.count ? shared.order[place] : 0;
  const uint32_t count = own >> 8;
  const uint32_t most = __shfl_sync(0xffffffffu, count, 0);
  const size_t own_slot = block.slot(own & 0xff);
  const float scale = count > 0 ? source.class_scale(own_slot) : 0.0f;
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
  float sum[Shared::kRows][Shared::kNumbers];
#pragma unroll
  for (uint32_t m = 0; m < Shared::kNumbers; ++m) {
    const uint32_t d = column + Shared::kLanes * m;
    const float origin = d < kDim ? source.book0[d] : 0.0f;
#pragma unroll
    for (uint32_t r = 0; r < Shared::kRows; ++r) sum[r][m] = origin;
  }
  for (uint32_t first = 0; first < most; first += Shared::kChunk) {
    auto& chunk = shared.chunk[threadIdx.x / 32][first / Shared::kChunk % 2];
#pragma unroll
    for (uint32_t j = 0; j < Shared::kCodes; ++j) {
      chunk[offset + j][lane % Shared::kWarpRows] =
          source.coefficient(code[j], scale, shared.steps[first + offset + j]);
    }
    if (first + Shared::kChunk < most) load(first + Shared::kChunk);
    __syncwarp();
    const float* basis = shared.basis + first * Shared::kWidth + column;
    const uint32_t there = min(Shared::kChunk, most - first);
#pragma unroll 4
    for (uint32_t j = 0; j < there; ++j) {
      static_assert(Shared::kRows == 4, "four floats are loaded");
      const float4 four = *reinterpret_cast<const float4*>(&chunk[j][group]);
      const float c[4] = {four.x, four.y, four.z, four.w};
#pragma unroll
      for (uint32_t m = 0; m < Shared::kNumbers; ++m) {
        const float number = basis[j * Shared::kWidth + Shared::kLanes * m];
#pragma unroll
        for (uint32_t r = 0; r < Shared::kRows; ++r) sum[r][m] = sum[r][m] + c[r] * number;
      }
    }
  }
#pragma unroll
  for (uint32_t r = 0; r < Shared::kRows; ++r) {
    if (first_row + group + r >= block.count) break;
    const uint32_t row = shared.order[first_row + group + r];
    float* to = out.sh + size_t{kDim} * block.gaussian(row & 0xff) + column;
#pragma unroll
    for (uint32_t m = 0; m < Shared::kNumbers; ++m) {
      const uint32_t d = column + Shared::kLanes * m;
      if (d >= kDim) break;
      float number = sum[r][m];
      if (number == 0.0f) {
        number = sum_of_terms(source, block.slot(row & 0xff), row >> 8, kDim, d);
      }
      to[Shared::kLanes * m] = number;
    }
  }
}

// SH of transform coefficients: rows of coefficients times the basis, a product of matrices without
// fused operations. Gaussians are taken by falling number of coefficients, so that those of a warp
// have about as many; zeros behind those that a row has change nothing but the sign of a zero.
template <unsigned kDim>
__device__ void expand_sh_transform(const DeviceJob& job, const DeviceArrays& out, uint32_t index,
                                    TransformShared<kDim>& shared) {
  using Shared = TransformShared<kDim>;
  const ExpandBlock block(job, index);
  if (block.count == 0) return;
  const ComponentSource source(job, block, L4D_COMPONENT_SH);
  const uint32_t t = threadIdx.x;
  const uint32_t coded = min(source.coding.num_coefficients, source.limit);
  for (uint32_t e = t; e < kMaxCoefficients * Shared::kWidth; e += kExpandThreads) {
    const uint32_t k = e / Shared::kWidth, d = e % Shared::kWidth;
    shared.basis[e] = k < coded && d < kDim ? source.book0[kDim * (k + 1) + d] : 0.0f;
  }
  if (t < kMaxCoefficients) shared.steps[t] = t < coded ? source.coding.steps[t] : 0.0f;
  order_by_coefficients(source, block, shared);

  for (uint32_t round = 0; round < 2; ++round) {
    const uint32_t first_row = (round * Shared::kWarps + t / 32) * Shared::kWarpRows;
    if (first_row < block.count) expand_sh_tile(source, block, out, first_row, shared);
  }
}

// SH of codebooks, or zeros: a thread for each kWidth numbers of a row, so that rows are read and
// written whole.
template <unsigned kDim, unsigned kWidth>
__device__ void expand_sh_rows(const DeviceJob& job, const DeviceArrays& out, uint32_t index) {
  static_assert(kDim % kWidth == 0 && (kWidth == 1 || kWidth == 4), "rows are cut evenly");
  constexpr uint32_t kPieces = kDim / kWidth;
  const ExpandBlock block(job, index);
  const ComponentSource source(job, block, L4D_COMPONENT_SH);
  const bool zero = source.is(ComponentCodingId::kZero) || block.page->has_sh == 0;
  for (uint32_t e = threadIdx.x; e < block.count * kPieces; e += kExpandThreads) {
    const uint32_t i = e / kPieces, first = e % kPieces * kWidth;
    const size_t slot = block.slot(i);
    const uint32_t depth = zero ? 0 : source.depth(slot);
    float row[kWidth] = {};
    if (depth == kLiteralDepth || kWidth == 1) {
      for (unsigned d = 0; d < kWidth; ++d) {
        row[d] = vq_number(source, slot, depth, kDim, first + d);
      }
    } else {
      for (uint32_t s = 0; s < depth; ++s) {
        const uint32_t index = source.value[s * source.stride + slot];
        const float4 v =
            *reinterpret_cast<const float4*>(source.book(s) + size_t{index} * kDim + first);
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
