// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "cli/command/context.h"
#include "cli/input/camera_arguments.h"
#include "eval/views/importance.h"

namespace l4d::cli {

// How importance is measured from views.
struct MeasureArguments {
  std::string agreement;
  bool all_views = false;
  std::string max_share;
  std::string metric = kDefault;
  std::string visibility = "few";
  size_t most_views = 0;  // measured, whether they agree or not; 0: until they agree
  uint64_t seed = 0;      // of the random signs of gauss-newton
  bool alone = false;     // without the other ranks, if there are any

  void add_options(Verb* verb);
  bool given() const;  // whether any option was
  void check() const;  // usage errors

  static constexpr const char* kDefault = "gauss-newton";
};

struct Importance : eval::MeasuredImportance {
  bool made_up = false;  // the views: for a scene that comes without cameras

  Json json() const;
  std::string text() const;
};
// Weights of all components of the scene, as l4d_measure_importance has them. Throws in builds
// without the renderer.
Importance measure_importance(Context& context, const std::string& verb, const io::Scene& scene,
                              const eval::CameraViews& views, const MeasureArguments& arguments);

// The importance of a scene's Gaussians for the encoder, which borrows what this holds.
class EncoderImportance {
 public:
  // `name` stands for the weights in messages. views: L4D_WEIGHT_VIEWS_*.
  void set_weights(const std::string& name, io::Weights weights, uint32_t views,
                   size_t num_gaussians);
  // [N] scene units.
  void set_min_sizes(std::vector<float> sizes) { min_sizes_ = std::move(sizes); }
  bool has_min_sizes() const { return !min_sizes_.empty(); }
  const std::vector<float>& min_sizes() const { return min_sizes_; }
  const io::Weights& weights() const { return weights_; }

  // Tells an encoder that has the scene.
  void tell(const EncoderHandle& encoder) const;

 private:
  io::Weights weights_;
  uint32_t views_ = L4D_WEIGHT_VIEWS_UNKNOWN;
  std::vector<float> min_sizes_;
};

}  // namespace l4d::cli
