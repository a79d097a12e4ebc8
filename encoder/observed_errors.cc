// SPDX-License-Identifier: Apache-2.0
#include "encoder/observed_errors.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <mutex>

#include "encoder/position_coding.h"
#include "encoder/scalar.h"
#include "encoder/shape_coder.h"
#include "libl4dcodec/base/threads.h"
#include "libl4dcodec/scene/layers.h"

namespace l4d {
namespace {

constexpr size_t kGrain = 4096;

SeenGaussian decoded(const EncoderScene& scene, const PositionCoding& positions,
                     const ScalarCoding& opacity, const CodedLayer& layer, size_t j) {
  SeenGaussian seen{};
  const size_t i = layer.members[j];
  if (layer.escape) {
    // Stored as given.
    const size_t from = scene.source[i];
    slice_in_double(scene.given.rotor + 8 * from, scene.given.log_scale + 4 * from, &seen);
  } else {
    float rotor[8], log_scale[4];
    decoded_shape(layer, j, rotor, log_scale);
    slice_in_double(rotor, log_scale, &seen);
  }
  if (!layer.fades()) seen.lambda = 0;
  seen.mean = layer.decoded_mean_t[j];
  seen.reference = reference_time(scene.timeline, seen.mean);
  for (size_t k = 0; k < 3; ++k) {
    seen.position[k] = coded_position(positions, layer, j, k);
  }
  seen.opacity = static_cast<double>(scalar_value(opacity, layer.opacity[j]));
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

GaussianErrors observed_errors(const EncoderScene& scene, const PositionCoding& positions,
                               const ScalarCoding& opacity, const std::vector<CodedLayer>& layers,
                               ErrorBounds bounds, int threads) {
  bounds.position_slack = bounds.opacity_slack = 0;
  GaussianErrors worst;
  std::mutex mutex;
  for (const CodedLayer& layer : layers) {
    parallel_for(threads, layer.members.size(), kGrain, [&](size_t first, size_t last) {
      GaussianErrors own;
      for (size_t j = first; j < last; ++j) {
        const size_t i = layer.members[j];
        const Sequence shown = scene.shown(i);
        take_worse(errors_of(scene.seen(i), decoded(scene, positions, opacity, layer, j),
                             shown.begin, shown.end, bounds, own.opacity),
                   &own);
      }
      std::lock_guard<std::mutex> lock(mutex);
      take_worse(own, &worst);
    });
  }
  return worst;
}

ErrorStatement statement_of(const GaussianErrors& errors, const ErrorBounds& bounds) {
  ErrorStatement s;
  s.stated = true;
  s.position = stated(errors.position);
  s.covariance = errors.covariance > 1 ? stated(errors.covariance) : 1;
  s.opacity = stated(errors.opacity);
  s.visible = stated(errors.visible);
  s.mean_t = stated(errors.mean_time);
  s.position_bound = static_cast<float>(bounds.position);
  s.covariance_bound = static_cast<float>(bounds.covariance);
  s.opacity_bound = static_cast<float>(bounds.opacity);
  s.visible_bound = static_cast<float>(bounds.visible);
  s.min_size = static_cast<float>(bounds.min_size);
  return s;
}

}  // namespace l4d
