// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "encoder/component/coded_component.h"

namespace l4d {

struct CodedLayer {
  unsigned level = 0;
  bool permanent = false;
  bool flat = false;    // of Gaussians with flat windows
  bool escape = false;  // Gaussians are stored as they are
  unsigned tier = 0;
  unsigned directory_bits = 0;
  MeanTimeCoding mean_times;
  ScalarCoding scale_factor;
  float log_scale_t = 0;            // of all Gaussians, where the layer is permanent
  std::vector<uint32_t> gaussians;  // [m] scene indices, ordered by bucket
  std::vector<uint32_t> bucket;     // [m]
  std::vector<BlockRange> blocks;   // runs of Gaussians; empty where the layer has no RCQ
  std::vector<uint16_t> factor;     // [m] SQ codes
  std::array<CodedComponent, L4D_COMPONENT_COUNT> component;  // SH: its codes alone, added last
  std::vector<uint16_t> mean_t;       // [m] binary16, or codes of fixed ones
  std::vector<uint16_t> mean_t_fine;  // [m] refinements of fixed ones
  // What the decoder will find, in double: the means follow from these.
  std::vector<double> decoded_mean_t;    // [m] seconds
  std::vector<double> decoded_lambda;    // [m]
  std::vector<double> decoded_velocity;  // [m, 3]
  std::vector<double> position;          // [m, 3] to be coded
  std::vector<float> opacity;            // [m] to be coded

  bool fades() const { return !permanent && !flat; }
  unsigned scale_dim() const { return permanent ? 3 : 4; }
};

// All that was coded of a scene.
struct CodedScene {
  CodedComponent sh;               // what all layers share of it: codebooks, or the basis
  std::vector<CodedLayer> layers;  // by level
};

}  // namespace l4d
