// SPDX-License-Identifier: Apache-2.0
#include "encoder/observed_errors.h"

#include <algorithm>
#include <mutex>

#include "encoder/page_builder.h"
#include "encoder/scalar.h"
#include "encoder/shape_coder.h"
#include "libl4dcodec/base/threads.h"
#include "libl4dcodec/scene/layers.h"

namespace l4d {
namespace {

constexpr size_t kGrain = 4096;

SeenGaussian decoded(const EncoderScene& scene, const SceneHeader& header, const CodedLayer& layer,
                     size_t j) {
  SeenGaussian seen{};
  const size_t i = layer.members[j];
  if (layer.header.raw_position) {
    seen = scene.seen(i);
  } else {
    float rotor[8], log_scale[4];
    decoded_shape(layer, j, rotor, log_scale);
    slice_in_double(rotor, log_scale, &seen);
  }
  if (layer.header.permanent) seen.lambda = 0;
  seen.mean = layer.decoded_mean_t[j];
  seen.reference = reference_time(scene.timeline, seen.mean);
  for (size_t k = 0; k < 3; ++k) {
    seen.position[k] = coded_position(header, layer.header, k, layer.position[3 * j + k]);
  }
  seen.opacity = static_cast<double>(scalar_value(header.opacity, layer.opacity[j]));
  return seen;
}

void take_worse(const GaussianErrors& e, GaussianErrors* worst) {
  worst->position = std::max(worst->position, e.position);
  worst->covariance = std::max(worst->covariance, e.covariance);
  worst->opacity = std::max(worst->opacity, e.opacity);
  worst->visible = std::max(worst->visible, e.visible);
}

}  // namespace

GaussianErrors observed_errors(const EncoderScene& scene, const SceneHeader& header,
                               const std::vector<CodedLayer>& layers, ErrorBounds bounds,
                               int threads) {
  bounds.position_slack = bounds.opacity_slack = 0;
  const double begin = scene.timeline.time_begin;
  GaussianErrors worst;
  std::mutex mutex;
  for (const CodedLayer& layer : layers) {
    parallel_for(threads, layer.members.size(), kGrain, [&](size_t first, size_t last) {
      GaussianErrors own;
      for (size_t j = first; j < last; ++j) {
        take_worse(errors_of(scene.seen(layer.members[j]), decoded(scene, header, layer, j), begin,
                             begin + scene.duration, bounds),
                   &own);
      }
      std::lock_guard<std::mutex> lock(mutex);
      take_worse(own, &worst);
    });
  }
  return worst;
}

}  // namespace l4d
