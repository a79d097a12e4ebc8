// SPDX-License-Identifier: Apache-2.0
// Columns to packed arrays on the device: what decoder/expand/pack.cc does. Escapes lie one behind
// the other, so that where they go is known only when those before them are counted.
#pragma once

#include "decoder/cuda/components.cuh"
#include "decoder/cuda/windows.cuh"

namespace l4d::cuda {

constexpr uint32_t kPackThreads = kExpandGaussians;
constexpr uint32_t kPackWarps = kPackThreads / 32;
constexpr uint8_t kPackedEscape = 255;

// What a Gaussian has of a component.
struct PackedDepth {
  uint32_t depth = 0;  // of the page
  bool escape = false;

  __device__ PackedDepth(const DeviceRequest& request, const ExpandBlock& block, unsigned c,
                         uint32_t i) {
    // Of SH nothing is there where the part that holds it is not.
    if (i >= block.count || (c == L4D_COMPONENT_SH && block.page->has_sh == 0)) return;
    const DeviceComponent& coding = block.layer->component[c];
    depth = coding.num_stages;
    if (coding.has_depth != 0) depth = request.columns.component[c].head[block.slot(i)];
    escape = coding.has_depth != 0 && depth == kEscapeDepth;
  }
};

__device__ inline bool is_wanted(const PackedArrays::Component& out) {
  return out.depth != nullptr || out.index != nullptr || out.escape != nullptr;
}

// A few loads are under way at a time: each store waits for its own.
__device__ inline void pack_indices(const uint16_t* from, size_t stride, uint32_t depth,
                                    uint32_t num_stages, uint16_t* to, size_t capacity) {
  constexpr uint32_t kAhead = 4;
  for (uint32_t s = 0; s < num_stages; s += kAhead) {
    uint16_t indices[kAhead];
#pragma unroll
    for (uint32_t j = 0; j < kAhead; ++j) {
      indices[j] = s + j < depth ? from[(s + j) * stride] : uint16_t{0};
    }
#pragma unroll
    for (uint32_t j = 0; j < kAhead; ++j) {
      if (s + j < num_stages) to[(s + j) * capacity] = indices[j];
    }
  }
}

// Rows [task.first, ..) of a page, one a thread.
__device__ inline void pack_rows(const DeviceRequest& request, const PackedArrays& out,
                                 uint32_t index) {
  const ExpandBlock block(request, index);
  const DeviceLayer& layer = *block.layer;
  const uint32_t i = threadIdx.x;
  const bool active = i < block.count;
  const size_t slot = block.slot(active ? i : 0), gaussian = block.gaussian(i);
  if (active && out.position != nullptr) {
    const uint64_t code = request.columns.morton[slot];
    for (unsigned axis = 0; axis < 3; ++axis) {
      out.position[3 * gaussian + axis] = unordered_half(morton_axis(code >> axis));
    }
  }
  if (active && out.mean_t != nullptr) {
    out.mean_t[gaussian] = layer.mean_t_coded != 0 ? request.columns.mean_t[slot] : uint16_t{0};
  }
  if (active && out.opacity != nullptr) {
    out.opacity[gaussian] =
        layer.opacity.is_coded != 0 ? request.columns.opacity[slot] : uint16_t{0};
  }
  if (active && out.scale_factor != nullptr) {
    out.scale_factor[gaussian] =
        layer.scale_factor.is_coded != 0 ? request.columns.scale_factor[slot] : uint16_t{0};
  }
  if (active && out.window != nullptr) {
    store_window(layer.flat != 0 ? window_of(request, layer, *block.page, slot) : FrameWindow(),
                 gaussian, out.window);
  }
  const uint32_t piece = block.page->piece + block.first / kExpandGaussians;
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    const PackedArrays::Component& to = out.component[c];
    const DeviceComponent& coding = layer.component[c];
    const PackedDepth own(request, block, c, i);
    if (active && to.depth != nullptr) {
      to.depth[gaussian] = own.escape ? kPackedEscape : static_cast<uint8_t>(own.depth);
    }
    if (active && to.index != nullptr) {
      pack_indices(request.columns.component[c].value + slot, request.columns.stride,
                   own.escape ? 0 : own.depth, coding.num_stages, to.index + gaussian,
                   out.capacity);
    }
    if (request.num_pieces == 0) continue;
    const uint32_t rows =
        static_cast<uint32_t>(__syncthreads_count(own.escape && is_wanted(to) ? 1 : 0));
    if (i == 0) {
      request.escapes[size_t{piece} * L4D_COMPONENT_COUNT + c] = {rows,
                                                                  uint64_t{rows} * coding.dim};
    }
  }
}

// What the host has counted.
__device__ inline void count_host_piece(const DeviceRequest& request, const PackedArrays& out,
                                        uint32_t index) {
  const HostPiece& piece = request.host_pieces[index];
  const uint32_t c = threadIdx.x;
  if (c >= L4D_COMPONENT_COUNT) return;
  const uint64_t rows = is_wanted(out.component[c]) ? piece.rows[c] : 0;
  request.escapes[size_t{piece.piece} * L4D_COMPONENT_COUNT + c] = {rows, rows * piece.dim[c]};
}

__device__ inline EscapeSum operator+(const EscapeSum& a, const EscapeSum& b) {
  return {a.rows + b.rows, a.numbers + b.numbers};
}
__device__ inline EscapeSum shuffle_up(const EscapeSum& v, uint32_t step) {
  return {__shfl_up_sync(0xffffffffu, v.rows, step), __shfl_up_sync(0xffffffffu, v.numbers, step)};
}
// The sum of the values of all lanes up to this one.
__device__ inline EscapeSum sum_until(EscapeSum v, uint32_t lane) {
  for (uint32_t step = 1; step < 32; step *= 2) {
    const EscapeSum before = shuffle_up(v, step);
    if (lane >= step) v = v + before;
  }
  return v;
}

// Counts of pieces to sums of those before them. A block of kSumThreads for each component.
constexpr uint32_t kSumThreads = 1024;
__device__ inline void sum_escapes(const DeviceRequest& request, EscapeSum* of_warps) {
  const uint32_t c = blockIdx.x, lane = threadIdx.x % 32, warp = threadIdx.x / 32;
  EscapeSum sum{0, 0};  // of the pieces before `base`
  for (uint32_t base = 0; base < request.num_pieces; base += kSumThreads) {
    const uint32_t piece = base + threadIdx.x;
    const bool active = piece < request.num_pieces;
    EscapeSum* at = request.escapes + size_t{active ? piece : 0} * L4D_COMPONENT_COUNT + c;
    const EscapeSum own = active ? *at : EscapeSum{0, 0};
    const EscapeSum until = sum_until(own, lane);
    if (lane == 31) of_warps[warp] = until;
    __syncthreads();
    if (warp == 0) of_warps[lane] = sum_until(of_warps[lane], lane);
    __syncthreads();
    EscapeSum before = sum;
    if (warp > 0) before = before + of_warps[warp - 1];
    // Without its own, what is summed up to a lane is what comes before it.
    if (active) {
      *at = {before.rows + until.rows - own.rows, before.numbers + until.numbers - own.numbers};
    }
    sum = sum + of_warps[kSumThreads / 32 - 1];
    __syncthreads();
  }
  if (threadIdx.x == 0) request.num_escapes[c] = sum.rows;
}
static_assert(kSumThreads == 32 * 32, "a warp sums up the sums of the warps");

// Escapes of the rows of an ExpandTask. of_warps: [kPackWarps]
__device__ inline void gather_escapes(const DeviceRequest& request, const PackedArrays& out,
                                      uint32_t index, uint32_t* of_warps) {
  const ExpandBlock block(request, index);
  const uint32_t i = threadIdx.x, lane = i % 32, warp = i / 32;
  const uint32_t piece = block.page->piece + block.first / kExpandGaussians;
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    const PackedArrays::Component& to = out.component[c];
    if (to.escape == nullptr) continue;
    const PackedDepth own(request, block, c, i);
    const uint32_t lanes = __ballot_sync(0xffffffffu, own.escape);
    if (lane == 0) of_warps[warp] = static_cast<uint32_t>(__popc(lanes));
    __syncthreads();
    uint32_t rank = static_cast<uint32_t>(__popc(lanes & ((1u << lane) - 1)));
    for (uint32_t w = 0; w < warp; ++w) rank += of_warps[w];
    __syncthreads();
    const EscapeSum before = request.escapes[size_t{piece} * L4D_COMPONENT_COUNT + c];
    if (!own.escape || before.rows + rank >= to.escape_capacity) continue;
    const DeviceComponent& coding = block.layer->component[c];
    uint16_t* row = to.escape + before.numbers + uint64_t{rank} * coding.dim;
    const uint16_t* from = request.columns.component[c].value + block.slot(i);
    for (uint32_t k = 0; k < coding.dim; ++k) {
      row[k] = from[(coding.num_stages + k) * request.columns.stride];
    }
  }
}

// Escapes of a HostPiece, dealt out to gridDim.y blocks.
__device__ inline void copy_escapes(const DeviceRequest& request, const PackedArrays& out,
                                    uint32_t index) {
  const HostPiece& piece = request.host_pieces[index];
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    const PackedArrays::Component& to = out.component[c];
    if (to.escape == nullptr) continue;
    const EscapeSum before = request.escapes[size_t{piece.piece} * L4D_COMPONENT_COUNT + c];
    if (before.rows >= to.escape_capacity) continue;
    const uint64_t rows = min(piece.rows[c], to.escape_capacity - before.rows);
    const uint16_t* from = reinterpret_cast<const uint16_t*>(request.upload + piece.at[c]);
    for (uint64_t k = blockIdx.y * kPackThreads + threadIdx.x; k < rows * piece.dim[c];
         k += uint64_t{gridDim.y} * kPackThreads) {
      to.escape[before.numbers + k] = from[k];
    }
  }
}

}  // namespace l4d::cuda
