// SPDX-License-Identifier: Apache-2.0
// Scales and rotors of a layer: which coding each gets, and what that decodes to.
#pragma once

#include "encoder/layer/coded_scene.h"
#include "encoder/layer/coder_options.h"
#include "encoder/prepare/quality.h"
#include "encoder/prepare/scene.h"

namespace l4d {

// Codes the scales and rotors of layer->gaussians, whose buckets and blocks are there. Fills
// factor, scale_factor, log_scale_t and component.
void code_shapes(const EncoderScene& scene, const CoderOptions& options, const Quality& quality,
                 CodedLayer* layer);

// Member j as a decoder will have it: rotor [8], log_scale [4].
void decoded_shape(const CodedLayer& layer, size_t j, float* rotor, float* log_scale);

// Codes components of single Gaussians more finely than the quality asks for: transforms in a finer
// step exponent, codebooks as an escape. Distinct Gaussians may be worked on at the same time.
class ShapeRefiner {
 public:
  ShapeRefiner(const EncoderScene& scene, CodedLayer* layer);

  // Whether component c (not SH) of Gaussian j could be coded a step finer, and now is.
  bool refine(size_t j, unsigned c);

  struct State {
    uint8_t depth = 0, step_exponent = 0;
    int16_t coefficient[4] = {0, 0, 0, 0};
    float decoded[4] = {0, 0, 0, 0};
  };
  State save(size_t j, unsigned c) const;
  void restore(size_t j, unsigned c, const State& state);

 private:
  void make_row(size_t j, unsigned c, float* row) const;

  const EncoderScene& scene_;
  CodedLayer& layer_;
};

// Leaves out coefficients that nobody has and notes whether there are escapes. Comes last.
void finish_shapes(CodedLayer* layer);

}  // namespace l4d
