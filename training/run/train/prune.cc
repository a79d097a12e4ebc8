// SPDX-License-Identifier: Apache-2.0
#include "training/run/train/prune.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "l4d/render.hpp"
#include "libl4dcodec/scene/slice.h"
#include "training/run/train/output.h"

namespace l4d::train {

std::vector<float> loss_without(const ModelState& model, const Capture& capture,
                                const ImageLoader& loader, const std::vector<uint32_t>& views,
                                const l4d_renderer_options& rendering, uint64_t seed) {
  std::vector<l4d_camera> cameras;
  for (uint32_t c = 0; c < capture.cameras.size(); ++c) cameras.push_back(loader.camera(c));
  std::vector<l4d_view> measured;
  for (const uint32_t view : views) {
    measured.push_back({capture.time_of(view), capture.views[view].camera, 0});
  }
  RendererHandle renderer(&rendering);
  renderer.set_gaussians(model.view(), capture.timeline());
  l4d_measure_options options = L4D_INIT(l4d_measure_options);
  options.metric = L4D_SENSITIVITY_GAUSS_NEWTON;
  options.seed = seed;
  std::vector<float> opacity(model.count);
  float* weights[L4D_WEIGHT_COUNT] = {};
  weights[L4D_WEIGHT_OPACITY] = opacity.data();
  renderer.measure_importance(cameras, measured, &options, weights, model.count);
  return loss_without(model, std::move(opacity));
}

std::vector<float> loss_without(const ModelState& model, std::vector<float> weights) {
  for (size_t i = 0; i < weights.size(); ++i) {
    const float change = linear_opacity(model.value.opacity[i], true) * weights[i];
    weights[i] = change * change;
  }
  return weights;
}

TrialEncode trial_encode(const io::Scene& scene, const io::Weights& weights,
                         const std::string& preset, uint32_t threads) {
  EncoderHandle encoder = make_encoder(scene, preset, threads);
  const l4d_importance importance = weights.view();
  encoder.set_importance(&importance);
  TrialEncode trial;
  trial.bytes = encoder.encode().size();
  trial.kept.assign(scene.count(), 0);
  for (const uint32_t row : encoder.order()) trial.kept[row] = 1;
  return trial;
}

double share_over(uint64_t bytes, uint64_t size, uint64_t left) {
  if (bytes <= size) return 0;
  const double room = static_cast<double>(size) / static_cast<double>(bytes);
  return 1 - std::pow(room, 1 / static_cast<double>(left));
}

std::vector<uint8_t> most_important(const std::vector<float>& values, double share) {
  std::vector<uint8_t> mask(values.size(), 1);
  std::vector<size_t> order(values.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) {
    return values[a] != values[b] ? values[a] < values[b] : a > b;
  });
  const size_t gone = std::min(static_cast<size_t>(share * static_cast<double>(values.size())),
                               values.empty() ? 0 : values.size() - 1);
  for (size_t k = 0; k < gone; ++k) mask[order[k]] = 0;
  return mask;
}

}  // namespace l4d::train
