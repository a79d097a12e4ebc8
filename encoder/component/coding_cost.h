// SPDX-License-Identifier: Apache-2.0
// What a coded component will take in the file, near enough to choose between codings: the length
// of an adaptive code (Krichevsky and Trofimov 1981), which has the cost of learning statistics in
// it.
#pragma once

#include <cstdint>
#include <vector>

#include "encoder/component/coded_component.h"

namespace l4d {

// Bits of hybrid integers in contexts of a channel.
class ChannelBits {
 public:
  explicit ChannelBits(size_t contexts) : counts_(contexts) {}
  void add(size_t context, uint16_t value);
  double total() const;

 private:
  std::vector<std::vector<uint32_t>> counts_;  // [contexts][tokens]
  double raw_ = 0;
};

// Indices, depths, escapes, step_exponents, coefficients, codebooks and bases. Tables of blocks
// come on top of nothing: with them, stage 0 counts as if it had none.
double component_bits(const CodedVq& component);
double component_bits(const CodedTransform& component);
inline double component_bits(const CodedRows&) { return 0; }
inline double component_bits(const CodedComponent& component) {
  return std::visit([](const auto& coded) { return component_bits(coded); }, component);
}

double codes_bits(const std::vector<uint16_t>& codes);

// Sum of importance x squared difference of two sets of rows [n, dim].
double weighted_error(const float* rows, const float* decoded, const float* importance, size_t n,
                      size_t dim);

}  // namespace l4d
