// SPDX-License-Identifier: Apache-2.0
#include "encoder/layer/observed_errors.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <mutex>

#include "encoder/layer/position_coding.h"
#include "encoder/layer/shape_coder.h"
#include "encoder/prepare/scalar.h"
#include "libl4dcodec/base/threads.h"
#include "libl4dcodec/scene/layers.h"

namespace l4d {
namespace {

SeenGaussian seen_of(const EncoderScene& scene, const CodedLayer& layer,
                     const DecodedGaussian& decoded) {
  SeenGaussian seen{};
  slice_in_double(decoded.rotor, decoded.log_scale, &seen);
  if (!layer.fades()) seen.lambda = 0;
  seen.mean = decoded.mean_t;
  seen.reference = reference_time(scene.timeline, seen.mean);
  for (size_t k = 0; k < 3; ++k) seen.position[k] = static_cast<double>(decoded.position[k]);
  seen.opacity = static_cast<double>(decoded.opacity);
  return seen;
}

void take_worse(const GaussianErrors& e, GaussianErrors* worst) {
  worst->position = std::max(worst->position, e.position);
  worst->covariance = std::max(worst->covariance, e.covariance);
  worst->opacity = std::max(worst->opacity, e.opacity);
  worst->visible = std::max(worst->visible, e.visible);
  worst->mean_time = std::max(worst->mean_time, e.mean_time);
}

// Beyond what other arithmetic in double may find.
constexpr double kAboveObserved = 1 + 0x1p-20;

float stated(double error) {
  constexpr float kLargest = std::numeric_limits<float>::max();
  const double above = error * kAboveObserved;
  if (!(above < static_cast<double>(kLargest))) return kLargest;
  const float rounded = static_cast<float>(above);
  return static_cast<double>(rounded) < above ? std::nextafter(rounded, kLargest) : rounded;
}

}  // namespace

DecodedGaussian decoded_gaussian(const EncoderScene& scene, const PositionCoding& positions,
                                 const ScalarCoding& opacity, const CodedLayer& layer, size_t j) {
  DecodedGaussian out;
  const size_t i = layer.gaussians[j];
  if (layer.escape) {
    // Stored as given.
    const size_t from = scene.source[i];
    std::copy_n(scene.given.rotor + 8 * from, 8, out.rotor);
    std::copy_n(scene.given.log_scale + 4 * from, 4, out.log_scale);
  } else {
    decoded_shape(layer, j, out.rotor, out.log_scale);
  }
  out.mean_t = layer.decoded_mean_t[j];
  for (size_t k = 0; k < 3; ++k) {
    out.position[k] = static_cast<float>(coded_position(positions, layer, j, k));
  }
  out.opacity = scalar_value(opacity, layer.opacity[j]);
  return out;
}

GaussianErrors observed_errors(const EncoderScene& scene, const PositionCoding& positions,
                               const ScalarCoding& opacity, const std::vector<CodedLayer>& layers,
                               ErrorBounds bounds, int threads, ErrorsAgainst against) {
  bounds.position_slack = bounds.opacity_slack = 0;
  GaussianErrors worst;
  std::mutex mutex;
  for (const CodedLayer& layer : layers) {
    parallel_for(threads, layer.gaussians.size(), kGrain, [&](size_t first, size_t last) {
      GaussianErrors own;
      for (size_t j = first; j < last; ++j) {
        const size_t i = layer.gaussians[j];
        const Sequence shown = scene.shown(i);
        take_worse(
            errors_of(against == ErrorsAgainst::kScene ? scene.stated(i) : scene.seen(i),
                      seen_of(scene, layer, decoded_gaussian(scene, positions, opacity, layer, j)),
                      shown.begin, shown.end, bounds, own.opacity),
            &own);
      }
      std::lock_guard<std::mutex> lock(mutex);
      take_worse(own, &worst);
    });
  }
  return worst;
}

Status check_bounds(const GaussianErrors& worst, const ErrorBounds& bounds) {
  const struct {
    const char* parameter;
    double error, bound, none;
    const char* way_out;
  } rows[] = {
      {"max-position-error", worst.position, bounds.position, 0, "move the scene nearer to 0"},
      {"max-covariance-factor", worst.covariance, bounds.covariance, 1,
       "move the scene nearer to 0"},
      {"max-opacity-error", worst.opacity, bounds.opacity, 0,
       "set opacity-bits to 0, which is as many as the bound needs"},
      {"max-visible-error", worst.visible, bounds.visible, 0, "move the scene nearer to 0"}};
  for (const auto& row : rows) {
    if (row.error <= row.bound || !(row.bound > row.none)) continue;
    char text[320];
    std::snprintf(
        text, sizeof text,
        "a Gaussian that is stored as exactly as can be is off by %.6g, and %s is %.6g: %s, or "
        "set %s to %.6g, or to 0 for no bound",
        row.error, row.parameter, row.bound, row.way_out, row.parameter, 1.001 * row.error);
    return Status(L4D_ERR_INVALID_SCENE, text);
  }
  return {};
}

ErrorStatement statement_of(const GaussianErrors& errors, const ErrorBounds& bounds) {
  ErrorStatement s;
  s.stated = true;
  // A bound that is kept is no less than the error rounded up; one that is missed is not stated.
  const auto state = [](double error, double bound, float* error_out, float* bound_out) {
    const bool kept = bound > 0 && error <= static_cast<double>(static_cast<float>(bound));
    *bound_out = kept ? static_cast<float>(bound) : 0;
    *error_out = kept ? std::min(stated(error), *bound_out) : stated(error);
  };
  state(errors.position, bounds.position, &s.position, &s.position_bound);
  state(errors.covariance, bounds.covariance, &s.covariance, &s.covariance_bound);
  if (!(errors.covariance > 1)) s.covariance = 1;
  state(errors.opacity, bounds.opacity, &s.opacity, &s.opacity_bound);
  state(errors.visible, bounds.visible, &s.visible, &s.visible_bound);
  s.mean_t = stated(errors.mean_time);
  s.min_size = static_cast<float>(bounds.min_size);
  s.colors = true;
  s.base_color = stated(errors.base_color);
  s.directional_color = stated(errors.directional_color);
  s.base_color_bound = static_cast<float>(bounds.base_color);
  s.directional_color_bound = static_cast<float>(bounds.directional_color);
  return s;
}

}  // namespace l4d
