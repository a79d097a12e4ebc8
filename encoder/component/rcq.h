// SPDX-License-Identifier: Apache-2.0
// Residual codebook quantisation: block codebooks made of pairs (layer codeword, residual
// codeword).
#pragma once

#include <vector>

#include "encoder/component/coded_component.h"

namespace l4d {

// A codebook of its own for every block, for code_blocks: as many entries as are useful to its
// Gaussians, `most` at most.
std::vector<std::vector<float>> train_block_codebooks(const float* rows, const float* weights,
                                                      size_t dim,
                                                      const std::vector<BlockRange>& blocks,
                                                      const ComponentSettings& settings,
                                                      size_t most);

// Tries a codebook of its own for every block of a component whose stage 0 is coded plainly, and
// keeps it where settings.rcq is 2, or where it saves more than it costs: bits of indices against
// bits of the table, the change of distortion counted in bits at the high-rate slope of 6 dB per
// bit and dimension. distance: [n] squared errors of the plain coding. block_codebooks: as
// train_block_codebooks gives them; those that hold more entries than the layer's codebook are
// trained again. Updates index, decoded, block_tables and residual_codebook of `component`.
void code_blocks(const float* rows, const float* weights, const std::vector<BlockRange>& blocks,
                 const ComponentSettings& settings, const std::vector<float>& distance,
                 const std::vector<std::vector<float>>& block_codebooks, CodedVq* component);

}  // namespace l4d
