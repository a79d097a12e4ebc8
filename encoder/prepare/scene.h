// SPDX-License-Identifier: Apache-2.0
// The scene as the encoder works on it: checked, pruned, in one gauge, with a weight per component.
#pragma once

#include <array>
#include <vector>

#include "encoder/prepare/error_bounds.h"
#include "encoder/prepare/settings.h"
#include "l4d/encode.h"
#include "libl4dcodec/base/status.h"
#include "libl4dcodec/scene/rendering.h"
#include "libl4dcodec/scene/window.h"

namespace l4d {

struct EncoderInput {
  l4d_gaussians gaussians{};  // with the opacities that are coded
  // [count] The scene's, where others are coded; else null. Borrowed.
  const float* stated_opacity = nullptr;
  l4d_timeline timeline{};
  l4d_placement placement{};
  l4d_importance importance = L4D_INIT(l4d_importance);  // borrowed
  l4d_rendering rendering = default_rendering();
  l4d_presentation presentation = default_presentation();

  // Of a stream that shows its Gaussians with those of other streams. 0 and null: it is all there
  // is. Gaussians that the error of the image is divided among: the price of error is one over
  // them.
  double shared_count = 0;
  // [count] How much more of the time of the stream a Gaussian is shown than of the time that its
  // importance is known for.
  const float* exposure = nullptr;
  // [count] Of the image, where no weights are given: estimated over all of the scene.
  const double* share = nullptr;

  const float* opacity_given() const {
    return stated_opacity != nullptr ? stated_opacity : gaussians.opacity;
  }
};

struct EncoderScene {
  size_t count = 0;
  double shared_count = 0;           // as EncoderInput has it
  bool has_double_times = false;     // lossless only: the input's times are mean_t as it is here
  l4d_gaussians given{};             // borrowed
  const float* min_sizes = nullptr;  // of what is given, or null
  const float* stated_opacity = nullptr;  // as EncoderInput has it
  uint32_t sh_degree = 0;
  l4d_timeline timeline{};
  double duration = 0;
  // The largest side of the box that holds nearly all of the scene: floaters do not count.
  double extent = 0;
  std::vector<uint32_t> source;  // [n] index in the input
  std::vector<double> position;  // [n, 3] at t_ref; lossless: as given
  std::vector<double> mean_t;    // [n]
  // The float32 values given, bit for bit (conversion through double may flush subnormals).
  std::vector<float> raw_position;  // [n, 3], lossless only
  std::vector<float> raw_mean_t;    // [n], lossless only, unless times were given as double
  std::vector<float> log_scale;     // [n, 4]
  std::vector<float> rotor;         // [n, 8] normalised; lossless: as given
  std::vector<float> opacity;       // [n] linear; lossless: as given
  std::vector<float> sh;            // [n, sh_dim]
  std::vector<double> velocity;     // [n, 3]
  std::vector<double> lambda;       // [n]; 0 of Gaussians with flat windows: they do not fade
  std::vector<FrameWindow> window;  // [n]; empty where no Gaussian has one
  std::array<std::vector<float>, L4D_COMPONENT_COUNT>
      weight;  // [n], of squared errors of codewords
  // [n] mean squared change of the image by a change of one number: of components and positions.
  std::array<std::vector<float>, L4D_COMPONENT_COUNT> importance;
  std::vector<float> position_importance;
  // [n] how much of the images is of a Gaussian; empty where the settings ask for no tiers.
  std::vector<float> light;
  uint64_t invalid_dropped = 0;
  uint64_t pruned = 0;

  // Gaussian i as it is seen, from the numbers given: nothing of what the encoder does to them.
  SeenGaussian seen(size_t i) const;
  // With the opacity that errors are stated against.
  SeenGaussian stated(size_t i) const;
  bool is_flat(size_t i) const { return !window.empty() && window[i].is_flat(); }
  // The part of the sequence outside which Gaussian i is not shown, for those that do not fade.
  Sequence shown(size_t i) const;
  // Coordinates k of all Gaussians, in order.
  std::vector<double> sorted_axis(size_t k) const;
  size_t sh_dim() const { return 3 * (sh_degree + 1) * (sh_degree + 1); }
  double sigma_t(size_t i) const;
};

// What a decoder's floats are over time: velocity, lambda and covariance of the slice.
void slice_in_double(const float* rotor, const float* log_scale, SeenGaussian* out);

Status check_input(const EncoderInput& input);
Status prepare_scene(const EncoderInput& input, const EncoderSettings& settings, int threads,
                     EncoderScene* out);

}  // namespace l4d
