// SPDX-License-Identifier: Apache-2.0
#include "render/cuda/codebooks.h"

#include <algorithm>
#include <string>

namespace l4d::render {
namespace {

constexpr uint64_t kMaxLiterals = (uint64_t{1} << (32 - kShDepthBits)) - 1;

}  // namespace

Status ShCodebooks::set(const l4d_codebook* books, uint32_t count, bool half) {
  if (count > L4D_MAX_STAGES) return invalid_argument("too many stages");
  uint32_t degree = 0;
  for (uint32_t s = 0; s < count; ++s) {
    const l4d_codebook& book = books[s];
    while (degree < 3 && 3 * sh_terms(degree) != book.dim) ++degree;
    if (3 * sh_terms(degree) != book.dim) {
      return invalid_argument("codebook " + std::to_string(s) + " is not of SH");
    }
    if (book.entries == nullptr || book.num_entries == 0 || book.num_entries > 65536 ||
        book.dim != books[0].dim) {
      return invalid_argument("codebook " + std::to_string(s) +
                              " has no entries, too many, or another width than the first");
    }
  }
  L4D_RETURN_IF_CUDA_ERROR(cudaDeviceSynchronize());
  books_ = {};
  max_rows_ = 0;
  max_literals_ = 0;
  degree_ = degree;
  const uint32_t stride = sh_stride(degree, half);
  const size_t row_bytes = stride * (half ? sizeof(uint16_t) : sizeof(float));
  size_t rows = 0;
  for (uint32_t s = 0; s < count; ++s) rows += books[s].num_entries;
  L4D_RETURN_IF_ERROR(memory_.reserve(std::max<size_t>(rows * row_bytes, 1)));
  unsigned char* at = memory_.as<unsigned char>();
  ShBooks made{};
  for (uint32_t s = 0; s < count; ++s) {
    made.book[s] = at;
    made.entries[s] = books[s].num_entries;
    launch_pad_books(books[s].entries, books[s].dim, stride, books[s].num_entries, half, at,
                     nullptr);
    at += books[s].num_entries * row_bytes;
  }
  made.num_stages = count;
  L4D_RETURN_IF_CUDA_ERROR(cudaGetLastError());
  L4D_RETURN_IF_CUDA_ERROR(cudaDeviceSynchronize());
  books_ = made;
  return {};
}

Status ShCodebooks::reserve(size_t rows, uint64_t literals) {
  if (empty()) return Status(L4D_ERR_INVALID_STATE, "there are no codebooks");
  if (literals > kMaxLiterals) return Status(L4D_ERR_LIMIT_EXCEEDED, "more than 2^28 - 1 literals");
  L4D_RETURN_IF_CUDA_ERROR(cudaDeviceSynchronize());
  max_rows_ = 0;
  max_literals_ = 0;
  books_.literals = nullptr;
  if (literals == 0) return {};
  const size_t pieces = (rows + kRankPiece - 1) / kRankPiece;
  L4D_RETURN_IF_ERROR(literals_.reserve(static_cast<size_t>(literals) * sh_stride(degree_, true) *
                                        sizeof(uint16_t)));
  L4D_RETURN_IF_ERROR(ranks_.reserve(std::max<size_t>(rows, 1) * sizeof(uint32_t)));
  L4D_RETURN_IF_ERROR(rank_states_.reserve((pieces + 1) * sizeof(uint32_t)));
  books_.literals = literals_.as<uint16_t>();
  max_rows_ = rows;
  max_literals_ = literals;
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
  if (indices.num_literals == 0) return {};
  if (indices.literal == nullptr || indices.depth == nullptr) {
    return invalid_argument("literals need their numbers, and depths that tell whose they are");
  }
  if (indices.first_literal > max_literals_ ||
      indices.num_literals > max_literals_ - indices.first_literal || count > max_rows_) {
    return invalid_argument("there is no room for so many literals");
  }
  const size_t pieces = static_cast<size_t>(count + kRankPiece - 1) / kRankPiece;
  L4D_RETURN_IF_CUDA_ERROR(
      cudaMemsetAsync(rank_states_.data(), 0, (pieces + 1) * sizeof(uint32_t), stream));
  launch_rank_literals(indices.depth, static_cast<uint32_t>(count), ranks_.as<uint32_t>(),
                       rank_states_.as<uint32_t>(), stream);
  const uint32_t stride = sh_stride(degree_, true);
  launch_pad_literals(indices.literal, 3 * sh_terms(degree_), stride,
                      static_cast<uint32_t>(indices.num_literals),
                      literals_.as<uint16_t>() + indices.first_literal * stride, stream);
  L4D_RETURN_IF_CUDA_ERROR(cudaGetLastError());
  out->rank = ranks_.as<uint32_t>();
  out->num_literals = static_cast<uint32_t>(indices.num_literals);
  out->first_literal = static_cast<uint32_t>(indices.first_literal);
  return {};
}

}  // namespace l4d::render
