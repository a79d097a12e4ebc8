// SPDX-License-Identifier: Apache-2.0
#include "render/cuda/store/codebooks.h"

#include <algorithm>
#include <string>

#include "l4d/experimental/packed.h"

namespace l4d::render {
namespace {

constexpr uint64_t kMaxEscapes = (uint64_t{1} << (32 - kShDepthBits)) - 1;

}  // namespace

Status ShCodebooks::set(const l4d_codebook* codebooks, uint32_t count, bool half) {
  if (count > L4D_MAX_STAGES) return invalid_argument("too many stages");
  uint32_t degree = 0;
  for (uint32_t s = 0; s < count; ++s) {
    const l4d_codebook& codebook = codebooks[s];
    while (degree < 3 && 3 * sh_terms(degree) != codebook.dim) ++degree;
    if (3 * sh_terms(degree) != codebook.dim) {
      return invalid_argument("codebook " + std::to_string(s) + " is not of SH");
    }
    if (codebook.entries == nullptr || codebook.num_entries == 0 || codebook.num_entries > 65536 ||
        codebook.dim != codebooks[0].dim) {
      return invalid_argument("codebook " + std::to_string(s) +
                              " has no entries, too many, or another width than the first");
    }
  }
  L4D_RETURN_IF_CUDA_ERROR(cudaDeviceSynchronize());
  codebooks_ = {};
  max_slots_ = 0;
  max_escapes_ = 0;
  degree_ = degree;
  const uint32_t stride = sh_stride(degree, half);
  const size_t row_bytes = stride * (half ? sizeof(uint16_t) : sizeof(float));
  size_t rows = 0;
  for (uint32_t s = 0; s < count; ++s) rows += codebooks[s].num_entries;
  L4D_RETURN_IF_ERROR(memory_.reserve(std::max<size_t>(rows * row_bytes, 1)));
  unsigned char* at = memory_.as<unsigned char>();
  ShCodebookTable made{};
  for (uint32_t s = 0; s < count; ++s) {
    made.codebook[s] = at;
    made.entries[s] = codebooks[s].num_entries;
    launch_pad_codebooks(codebooks[s].entries, codebooks[s].dim, stride, codebooks[s].num_entries,
                         half, at, nullptr);
    at += codebooks[s].num_entries * row_bytes;
  }
  made.num_stages = count;
  L4D_RETURN_IF_CUDA_ERROR(cudaGetLastError());
  L4D_RETURN_IF_CUDA_ERROR(cudaDeviceSynchronize());
  codebooks_ = made;
  return {};
}

Status ShCodebooks::reserve(size_t slots, uint64_t escapes) {
  if (empty()) return Status(L4D_ERR_INVALID_STATE, "there are no codebooks");
  if (escapes > kMaxEscapes) return Status(L4D_ERR_LIMIT_EXCEEDED, "more than 2^28 - 1 escapes");
  L4D_RETURN_IF_CUDA_ERROR(cudaDeviceSynchronize());
  max_slots_ = 0;
  max_escapes_ = 0;
  codebooks_.escapes = nullptr;
  if (escapes == 0) return {};
  const size_t pieces = (slots + kRankPiece - 1) / kRankPiece;
  L4D_RETURN_IF_ERROR(
      escapes_.reserve(static_cast<size_t>(escapes) * sh_stride(degree_, true) * sizeof(uint16_t)));
  L4D_RETURN_IF_ERROR(ranks_.reserve(std::max<size_t>(slots, 1) * sizeof(uint32_t)));
  L4D_RETURN_IF_ERROR(rank_states_.reserve((pieces + 1) * sizeof(uint32_t)));
  codebooks_.escapes = escapes_.as<uint16_t>();
  max_slots_ = slots;
  max_escapes_ = escapes;
  return {};
}

Status ShCodebooks::take(const l4d_cuda_sh_indices& indices, uint64_t count, ShIndices* out,
                         cudaStream_t stream) {
  if (empty()) return Status(L4D_ERR_INVALID_STATE, "there are no codebooks");
  *out = {};
  out->depth = indices.depth;
  out->index = indices.index;
  out->stride = indices.stride;
  if (count > 0 && (indices.index == nullptr || indices.stride < count)) {
    return invalid_argument("there are no indices, or their stride is below the Gaussians");
  }
  if (indices.num_escapes == 0) return {};
  if (indices.escape == nullptr || indices.depth == nullptr) {
    return invalid_argument("escapes need their numbers, and depths that tell whose they are");
  }
  if (indices.num_escapes > max_escapes_ || count > max_slots_) {
    return invalid_argument("capacity is too small for so many escapes");
  }
  const size_t pieces = static_cast<size_t>(count + kRankPiece - 1) / kRankPiece;
  L4D_RETURN_IF_CUDA_ERROR(
      cudaMemsetAsync(rank_states_.data(), 0, (pieces + 1) * sizeof(uint32_t), stream));
  launch_rank_escapes(indices.depth, static_cast<uint32_t>(count), ranks_.as<uint32_t>(),
                      rank_states_.as<uint32_t>(), stream);
  const uint32_t stride = sh_stride(degree_, true);
  launch_pad_escapes(indices.escape, 3 * sh_terms(degree_), stride,
                     static_cast<uint32_t>(indices.num_escapes), escapes_.as<uint16_t>(), stream);
  L4D_RETURN_IF_CUDA_ERROR(cudaGetLastError());
  out->rank = ranks_.as<uint32_t>();
  out->num_escapes = static_cast<uint32_t>(indices.num_escapes);
  return {};
}

}  // namespace l4d::render
