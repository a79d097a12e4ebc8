// SPDX-License-Identifier: Apache-2.0
// How many codewords a stage is worth, and to which rows, where a bit has a price in weighted
// squared error.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace l4d {

// The error of a quantiser falls with the number of its codewords as k^(-2 / d). Vectors whose
// numbers depend on each other have a lower d than they have numbers.
double effective_dimension(double error_before, double error_after, double codewords);

// What is left of an error of 1.
double error_after_stage(double codewords, double effective_dim);

// Bits of a codebook of k codewords: binary16 numbers, which compress little.
double codebook_bits(double codewords, size_t dim);

// The number of codewords, a power of two up to `most`, at which error and price of indices and
// codebook together are least. error: sum over the n rows, before the stage.
uint32_t codewords_by_cost(double error, size_t n, size_t dim, double effective_dim,
                           double rd_lambda, uint32_t most);

struct StageChoice {
  std::vector<uint32_t> members;  // ascending; empty = the stage is not worth its codebook
  uint32_t codewords = 0;
};

// Which of `members` another stage is worth. error: by row, of all rows.
StageChoice choose_stage(const std::vector<uint32_t>& members, const std::vector<float>& error,
                         size_t dim, double effective_dim, double rd_lambda, uint32_t most);

}  // namespace l4d
