// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "cli/camera_arguments.h"
#include "cli/common.h"
#include "io/ply/weights.h"
#include "l4d/render.h"

namespace l4d::cli {

// How importance is measured from views.
struct MeasureArguments {
  std::string agreement;
  bool all_views = false;
  std::string max_share;
  std::string metric = kDefault;
  std::string visibility = "few";
  uint64_t seed = 0;   // of the random signs of gauss-newton
  bool alone = false;  // without the other ranks, if there are any

  void add_options(Verb* verb);
  bool given() const;  // whether any option was
  void check() const;  // usage errors

  static constexpr const char* kDefault = "gauss-newton";
};

struct Importance {
  io::Weights weights;
  l4d_measure_report report;
  double seconds = 0;

  Json json() const;
  std::string text() const;
};
// The weights that the encoder takes, and where they stand.
inline constexpr std::pair<uint32_t, std::vector<float> io::Weights::*> kWeightColumns[] = {
    {L4D_WEIGHT_ALPHA_T, &io::Weights::alpha_t},
    {L4D_WEIGHT_SH, &io::Weights::sh},
    {L4D_WEIGHT_SCALE, &io::Weights::scale},
    {L4D_WEIGHT_ROTOR_SPATIAL, &io::Weights::rotor_spatial},
    {L4D_WEIGHT_ROTOR_TEMPORAL, &io::Weights::rotor_temporal},
    {L4D_WEIGHT_POSITION, &io::Weights::position},
    {L4D_WEIGHT_OPACITY, &io::Weights::opacity},
    {L4D_WEIGHT_MEAN_T, &io::Weights::mean_t}};

// Weights of all components of the scene, as l4d_measure_importance has them. Throws in builds
// without the renderer.
Importance measure_importance(Context& context, const std::string& verb, const io::Scene& scene,
                              const eval::CameraViews& views, const MeasureArguments& arguments);

// Weights in the form the encoder takes them: it borrows what this holds.
class EncoderWeights {
 public:
  // `name` stands for the weights in messages.
  void set(const EncoderHandle& encoder, const std::string& name, io::Weights weights,
           size_t num_gaussians);
  const io::Weights& get() const { return weights_; }

 private:
  io::Weights weights_;
};

}  // namespace l4d::cli
