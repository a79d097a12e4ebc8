// SPDX-License-Identifier: Apache-2.0
// Vector quantisation of whole 4D covariances: what the paper shows to fail (Table 4, row a), for
// comparison. No part of the format.
#pragma once

#include <vector>

#include "io/scene/scene.h"

namespace l4d::bench {

struct Cov4d {
  double index_bits = 0;      // order-0 entropy of all indices
  double codebook_bytes = 0;  // at 16 bits a number
};

// Replaces scales and rotors by those of the covariance's codeword, as C3DGS does it for 3D: the
// covariance is divided by its trace, its upper triangle is clustered by plain k-means under
// weights, and the scale factor is kept (it costs 8 bits, as in the format).
Cov4d quantise_covariances(io::Scene& scene, const std::vector<float>& weights,
                           size_t num_codewords, int iterations);

}  // namespace l4d::bench
