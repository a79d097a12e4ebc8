// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "io/file/memory.h"
#include "l4d/encode.h"

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

  // As the encoder takes them: borrowed.
  l4d_importance view() const;
  // Makes all columns, for what writes them: by L4D_WEIGHT_*.
  std::array<float*, L4D_WEIGHT_COUNT> make_columns(size_t num_gaussians);
};
inline constexpr std::pair<uint32_t, std::vector<float> Weights::*> kWeightColumns[] = {
    {L4D_WEIGHT_ALPHA_T, &Weights::alpha_t},
    {L4D_WEIGHT_SH, &Weights::sh},
    {L4D_WEIGHT_SCALE, &Weights::scale},
    {L4D_WEIGHT_ROTOR_SPATIAL, &Weights::rotor_spatial},
    {L4D_WEIGHT_ROTOR_TEMPORAL, &Weights::rotor_temporal},
    {L4D_WEIGHT_POSITION, &Weights::position},
    {L4D_WEIGHT_OPACITY, &Weights::opacity},
    {L4D_WEIGHT_MEAN_T, &Weights::mean_t}};
// holder: counts the weights before they are read.
Weights read_weights_ply(const std::string& path, const Hold& holder = {});
// All columns must be there but position, opacity and mean_t; sh is written as weight_sh.
void write_weights_ply(const std::string& path, const Weights& weights);

}  // namespace l4d::io
