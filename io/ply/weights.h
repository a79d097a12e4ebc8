// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "io/file/memory.h"

namespace l4d::io {

// Per-Gaussian importance, a PLY with `comment l4d_weights 1`. Empty vectors where a column lacks.
struct Weights {
  std::vector<float> alpha_t, sh, scale, rotor_spatial, rotor_temporal, position, opacity, mean_t;
  // Measured as L4D_SENSITIVITY_GAUSS_NEWTON, and not as L4D_SENSITIVITY_SUM.
  bool gauss_newton = false;
  // sh is the column weight_sh_gradient, zero for Gaussians whose colour is clamped, and not
  // weight_sh.
  bool sh_is_clamped = false;
  size_t count = 0;
  std::shared_ptr<void> memory;  // counts them
};
// holder: counts the weights before they are read.
Weights read_weights_ply(const std::string& path, const Hold& holder = {});
// All columns must be there but position, opacity and mean_t; sh is written as weight_sh.
void write_weights_ply(const std::string& path, const Weights& weights);

}  // namespace l4d::io
