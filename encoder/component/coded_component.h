// SPDX-License-Identifier: Apache-2.0
// A component of a set of Gaussians as codes, and what it is coded by.
#pragma once

#include <cstdint>
#include <functional>
#include <variant>
#include <vector>

#include "encoder/component/transform_coder.h"
#include "encoder/search/nearest.h"
#include "libl4dcodec/container/scene_header.h"
#include "libl4dcodec/quant/codebook.h"

namespace l4d {

struct ComponentSettings {
  uint32_t codebook_size = 4096;
  std::vector<float> stages{1.0f};
  double escape_threshold = 0;  // 0 = never
  // Above 0: price of a bit in weighted squared error. Then sizes of codebooks (codebook_size at
  // most), depths and escapes are what they are worth, and `stages` and escape_threshold count
  // for nothing.
  double rd_lambda = 0;
  int refine_rounds = 0;  // see refine_stages
  // Rows that it refuses get further stages, or are escapes. Empty: all rows are fine.
  RowCheck keeps;
  int rcq = 0;  // 0 never, 1 where it pays, 2 always; needs blocks
  uint32_t rcq_size = 512;
  int iterations = 10;
  size_t sample_per_codeword = 24;
  uint64_t seed = 0;
  int threads = 0;
  NearestDevice* device = nullptr;
  const std::function<bool()>* cancelled = nullptr;
};

// Gaussians [begin, end) of the set form an RCQ block.
struct BlockRange {
  size_t begin = 0;
  size_t end = 0;
};

// In codebooks.
struct CodedVq : CodedRows {
  std::vector<std::vector<float>> codebooks;  // per stage [entries, dim], values of its elements
  std::vector<float> steps;                   // per stage: of SQ elements; 0 = binary16
  std::vector<uint8_t> depth;                 // [n]; kEscapeDepth = escape
  std::vector<std::vector<uint16_t>> index;   // per stage [n], valid where depth > stage
  bool any_escape = false;
  std::vector<float> residual_codebook;  // RCQ, [entries, dim]; empty = no RCQ
  // One per block; empty = that block indexes the layer's codebook.
  std::vector<std::vector<RcqPair>> block_tables;
  double weighted_distortion = 0;  // sum of weight x squared error
};

// Stored as they are.
struct RawRows : CodedRows {};

// In the order of ComponentCodingId. Rows alone are all zero.
using CodedComponent = std::variant<CodedRows, RawRows, CodedVq, CodedTransform>;

inline CodedRows& rows_of(CodedComponent& c) {
  return std::visit([](CodedRows& rows) -> CodedRows& { return rows; }, c);
}
inline const CodedRows& rows_of(const CodedComponent& c) {
  return std::visit([](const CodedRows& rows) -> const CodedRows& { return rows; }, c);
}

// Drops Gaussians (keep[i] = 0) from a coded set.
void drop_gaussians(CodedComponent& component, const std::vector<uint8_t>& keep);

// What pages hold of the Gaussians `which`, in that order: depths and indices, or step_exponents,
// EOB indices and coefficients; `decoded` where there are escapes. Codebooks and bases stay behind.
CodedComponent codes_of(const CodedComponent& component, const std::vector<uint32_t>& which,
                        int threads);

// Leaves the codebooks or the basis alone.
void drop_codes(CodedComponent& component);

// Orders every codebook by use, most used first, without the entries nobody uses: small numbers
// become frequent, which any entropy coder after this likes. Changes no decoded value.
void sort_codebooks_by_frequency(CodedVq& component, const std::vector<BlockRange>& blocks);

// What the header will say of a coded component, but for where its chunks lie.
void describe_component(const CodedComponent& component, ComponentCoding* coding);

}  // namespace l4d
