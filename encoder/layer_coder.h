// SPDX-License-Identifier: Apache-2.0
// One layer from Gaussians to codes, as a decoder will see it.
#pragma once

#include <array>
#include <vector>

#include "encoder/coder_options.h"
#include "encoder/component_coder.h"
#include "encoder/layer_plan.h"
#include "encoder/scene.h"

namespace l4d {

struct CodedLayer {
  unsigned level = 0;
  bool permanent = false;
  bool flat = false;    // of Gaussians with flat windows
  bool escape = false;  // members are stored as they are
  unsigned tier = 0;
  unsigned directory_bits = 0;
  MeanTimeCoding mean_times;
  ScalarCoding scale_factor;
  float log_scale_t = 0;           // of all members, where the layer is permanent
  std::vector<uint32_t> members;   // [m] scene indices, ordered by bucket
  std::vector<uint32_t> bucket;    // [m]
  std::vector<BlockRange> blocks;  // runs of members; empty where the layer has no RCQ
  std::vector<uint16_t> factor;    // [m] SQ codes
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

// Codes the members of a plan. Those whose decoded form no longer fits the layer are left out and
// returned in `demoted` (ascending) for the next coarser layer. Those that no code brings within
// options.bounds are left out too and added to `escapes`, unless that is null.
CodedLayer code_layer(const EncoderScene& scene, const LayerPlan& plan, const CoderOptions& options,
                      std::vector<uint32_t>* demoted, std::vector<uint32_t>* escapes);

// A layer that holds its members, whose extents its level allows, as they are. (Of a
// coarser one, times from the middle of its buckets would be rounded more than brief ones bear.)
CodedLayer code_escapes(const EncoderScene& scene, unsigned level, bool flat,
                        const std::vector<uint32_t>& members);

}  // namespace l4d
