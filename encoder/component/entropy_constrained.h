// SPDX-License-Identifier: Apache-2.0
// Entropy-constrained vector quantisation (Chou, Lookabaugh and Gray 1989): codewords that are used
// often cost few bits, and a point takes the one with the least weighted error plus price of bits.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "encoder/search/nearest.h"

namespace l4d {

struct EntropyConstraint {
  // Price of a bit, relative to the slope at which the error of the codebook at hand falls with its
  // rate; 1 balances the two, 0 leaves the plain quantiser.
  double price = 0;
  int rounds = 3;  // of assigning and moving codewords
  int threads = 0;
  NearestDevice* device = nullptr;
};

// Moves the codewords of `codebook` [k, dim] and assigns rows [n, dim] to them. labels [n] come in
// as the nearest codewords. Codewords keep binary16 values; those that nobody uses stay where they
// are.
void constrain_entropy(const float* rows, const float* weights, size_t n, size_t dim,
                       const EntropyConstraint& constraint, std::vector<float>* codebook,
                       std::vector<uint32_t>* labels);

}  // namespace l4d
