// SPDX-License-Identifier: Apache-2.0
// Numbers of components from columns (spec: "Reconstruction"): the operations of
// decoder/expand/expand.cc and of the reference loops, in the same order.
#pragma once

#include "decoder/cuda/device_types.h"
#include "decoder/cuda/values.cuh"
#include "libl4dcodec/base/half.h"

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

  __device__ ExpandBlock(const DeviceRequest& request, uint32_t index) {
    const ExpandTask task = request.expands[index];
    page = &request.pages[task.page];
    layer = &request.layers[page->layer];
    first = task.first;
    count = min(page->n - first, kExpandGaussians);
    // Columns of damaged pages hold anything.
    if ((request.faults[2 * task.page] | request.faults[2 * task.page + 1]) != kPageOk) count = 0;
  }
  __device__ size_t slot(uint32_t i) const { return size_t{page->slot} + first + i; }
  __device__ size_t gaussian(uint32_t i) const { return page->first + first + i; }
};

// One component of the pages of a layer.
struct ComponentSource {
  const DeviceComponent& coding;
  const uint8_t* head;
  const uint8_t* eob_index;
  const uint16_t* value;
  size_t stride;
  const float* codebook0;
  uint32_t limit;  // coefficients that count

  __device__ ComponentSource(const DeviceRequest& request, const ExpandBlock& block, unsigned c)
      : coding(block.layer->component[c]),
        head(request.columns.component[c].head),
        eob_index(request.columns.component[c].eob_index),
        value(request.columns.component[c].value),
        stride(request.columns.stride),
        codebook0(block.page->codebook[c] == kNoCodebook
                      ? coding.codebook[0]
                      : reinterpret_cast<const float*>(request.upload + block.page->codebook[c])),
        limit(c == L4D_COMPONENT_SH ? block.page->sh_limit : kMaxCoefficients) {}

  __device__ bool is(ComponentCodingId id) const {
    return coding.coding == static_cast<uint32_t>(id);
  }
  __device__ const float* codebook(unsigned stage) const {
    return stage == 0 ? codebook0 : coding.codebook[stage];
  }
  __device__ uint32_t depth(size_t slot) const {
    return coding.has_depth != 0 ? head[slot] : coding.num_stages;
  }
  __device__ uint32_t coefficients(size_t slot) const {
    if (limit == 0) return 0;
    if (coding.num_eob_indices <= 1) return min(coding.num_coefficients, limit);
    const uint32_t r = eob_index[slot];
    return r == 0 ? 0 : min(uint32_t{coding.eob_table[r - 1]}, limit);
  }
  // c_k of the synthesis, from a zigzag code.
  __device__ static float coefficient(uint32_t code, float scale, float step) {
    return (static_cast<float>(unzigzag(code)) * scale) * step;
  }
  __device__ float step_scale(size_t slot) const {
    return 1.0f / static_cast<float>(1u << head[slot]);
  }
};

// One number of the row of a component in codebooks.
__device__ inline float vq_number(const ComponentSource& source, size_t slot, uint32_t depth,
                                  uint32_t dim, uint32_t k) {
  if (depth == kEscapeDepth) {
    return half_to_float(source.value[(source.coding.num_stages + k) * source.stride + slot]);
  }
  float sum = 0.0f;
  for (uint32_t s = 0; s < depth; ++s) {
    const uint32_t index = source.value[s * source.stride + slot];
    const float number = source.codebook(s)[size_t{index} * dim + k];
    sum = s == 0 ? number : sum + number;
  }
  return sum;
}

// The row of a component of a few numbers.
template <unsigned kDim>
__device__ void component_row(const ComponentSource& source, size_t slot, float* row) {
  if (source.is(ComponentCodingId::kTransform)) {
    for (unsigned d = 0; d < kDim; ++d) row[d] = source.codebook0[d];
    const uint32_t count = source.coefficients(slot);
    const float scale = source.step_scale(slot);
    // Not more than numbers (TRAN-1), and asked for all at once.
    uint16_t codes[kDim];
#pragma unroll
    for (unsigned k = 0; k < kDim; ++k) {
      codes[k] = k < count ? source.value[k * source.stride + slot] : uint16_t{0};
    }
#pragma unroll
    for (unsigned k = 0; k < kDim; ++k) {
      if (k >= count) break;
      const float c = source.coefficient(codes[k], scale, source.coding.steps[k]);
      for (unsigned d = 0; d < kDim; ++d)
        row[d] = row[d] + c * source.codebook0[kDim * (k + 1) + d];
    }
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

}  // namespace l4d::cuda
