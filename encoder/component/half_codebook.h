// SPDX-License-Identifier: Apache-2.0
// Codebooks of binary16 values.
#pragma once

#include <cstdint>
#include <vector>

#include "encoder/component/coded_component.h"

namespace l4d {

// How many codewords of `wanted` n Gaussians are worth, 1 at least.
uint32_t useful_entries(uint32_t wanted, size_t n);

// K-means as the settings say, [<= entries, dim] of binary16 values. rows: [n, dim]; weights: [n].
// salt: tells the random numbers of one codebook from those of others.
std::vector<float> train_half_codebook(const float* rows, const float* weights, size_t n,
                                       size_t dim, uint32_t entries,
                                       const ComponentSettings& settings, uint64_t salt);

}  // namespace l4d
