// SPDX-License-Identifier: Apache-2.0
#include "training/run/train/output.h"

#include <nlohmann/json.hpp>
#include <vector>

#include "io/camera/first_view.h"
#include "io/file/file.h"
#include "io/scene/rendering_text.h"
#include "l4d/render.hpp"

namespace l4d::train {
namespace {

using Json = nlohmann::ordered_json;
using io::Error;

constexpr double kErrorGain = 4;  // in previews

struct WeightColumn {
  uint32_t which;
  std::vector<float> io::Weights::*column;
};
constexpr WeightColumn kWeightColumns[] = {
    {L4D_WEIGHT_ALPHA_T, &io::Weights::alpha_t},
    {L4D_WEIGHT_SH, &io::Weights::sh},
    {L4D_WEIGHT_SCALE, &io::Weights::scale},
    {L4D_WEIGHT_ROTOR_SPATIAL, &io::Weights::rotor_spatial},
    {L4D_WEIGHT_ROTOR_TEMPORAL, &io::Weights::rotor_temporal},
    {L4D_WEIGHT_POSITION, &io::Weights::position},
    {L4D_WEIGHT_OPACITY, &io::Weights::opacity},
    {L4D_WEIGHT_MEAN_T, &io::Weights::mean_t},
};

}  // namespace

io::Scene scene_of(const ModelState& model, const l4d_timeline& timeline) {
  io::Scene scene;
  static_cast<AttributeArrays&>(scene) = model.value;
  scene.resize(static_cast<size_t>(model.count));
  scene.timeline = timeline;
  scene.source = "training";
  return scene;
}

ModelState model_of(const io::Scene& scene) {
  io::Scene copy = scene;
  io::positions_to_reference_time(copy);
  io::opacity_to_logit(copy);
  ModelState model;
  model.allocate(copy.count(), copy.sh_degree);
  model.count = copy.count();
  model.value = copy;
  // The renderer takes times of float32 here, as the training has them.
  model.value.mean_t_double.clear();
  return model;
}

l4d_presentation first_view(const Capture& capture, const ImageLoader& loader) {
  l4d_presentation p;
  l4d_presentation_init(&p);
  std::vector<l4d_camera> training;
  for (uint32_t c = 0; c < capture.cameras.size(); ++c) {
    if (capture.cameras[c].split == "train") training.push_back(loader.camera(c));
  }
  io::state_first_view(training, frame_of(capture).radius, &p);
  return p;
}

l4d_presentation as_read(const l4d_presentation& presentation) {
  l4d_presentation read;
  l4d_presentation_init(&read);
  io::parse_presentation(io::presentation_text(presentation), &read);
  return read;
}

void write_cameras(const std::string& path, const Capture& capture, const ImageLoader& loader) {
  Json cameras = Json::array();
  for (uint32_t c = 0; c < capture.cameras.size(); ++c) {
    const l4d_camera& camera = loader.camera(c);
    const double* m = camera.world_to_camera;
    Json w2c = Json::array();
    for (size_t r = 0; r < 3; ++r) {
      w2c.push_back({m[4 * r], m[4 * r + 1], m[4 * r + 2], m[4 * r + 3]});
    }
    w2c.push_back({0, 0, 0, 1});
    cameras.push_back({{"id", capture.cameras[c].source.id},
                       {"split", capture.cameras[c].split},
                       {"width", camera.width},
                       {"height", camera.height},
                       {"near", camera.near_plane},
                       {"K", {{camera.fx, 0, camera.cx}, {0, camera.fy, camera.cy}, {0, 0, 1}}},
                       {"w2c", w2c}});
  }
  const Json root = {{"fps", capture.fps}, {"frames", capture.frames}, {"cameras", cameras}};
  const std::string text = root.dump(1) + "\n";
  io::OutputFile file(path);
  file.write(text.data(), text.size());
  file.commit();
}

io::Weights measure_weights(const io::Scene& scene, const Capture& capture,
                            const ImageLoader& loader, uint32_t threads, uint64_t seed) {
  std::vector<l4d_camera> cameras;
  for (uint32_t c = 0; c < capture.cameras.size(); ++c) cameras.push_back(loader.camera(c));
  std::vector<l4d_view> views;
  for (const CaptureView& view : capture.views) {
    if (capture.cameras[view.camera].split == "train") views.push_back({view.time, view.camera, 0});
  }
  l4d_renderer_options options;
  l4d_renderer_options_init(&options);
  options.threads = threads;
  RendererHandle renderer(&options);
  renderer.set_gaussians(scene.view(), scene.timeline);
  l4d_measure_options measure;
  l4d_measure_options_init(&measure);
  measure.metric = L4D_SENSITIVITY_GAUSS_NEWTON;
  measure.seed = seed;
  l4d_sensitivity* measured = nullptr;
  renderer.check(l4d_measure_importance(
      renderer.get(), cameras.data(), static_cast<uint32_t>(cameras.size()), views.data(),
      views.size(), &measure, nullptr, nullptr, nullptr, &measured));
  const SensitivityHandle sensitivity(measured, scene.count());
  io::Weights weights;
  weights.count = scene.count();
  weights.gauss_newton = true;
  for (const auto& [which, column] : kWeightColumns) {
    weights.*column = sensitivity.weights(which);
  }
  return weights;
}

std::string preset_names() {
  std::string names;
  for (uint32_t i = 0; l4d_encoder_preset_name(i) != nullptr; ++i) {
    names += std::string(names.empty() ? "" : ", ") + l4d_encoder_preset_name(i);
  }
  return names;
}

void check_preset(const std::string& preset) {
  for (uint32_t i = 0; l4d_encoder_preset_name(i) != nullptr; ++i) {
    if (preset == l4d_encoder_preset_name(i)) return;
  }
  throw Error(L4D_ERR_INVALID_ARGUMENT,
              "--encode is " + preset + "; it must be a preset of the encoder: " + preset_names());
}

EncoderHandle make_encoder(const io::Scene& scene, const io::Weights& weights,
                           const std::string& preset, uint32_t threads) {
  l4d_encoder_options options;
  l4d_encoder_options_init(&options);
  options.threads = threads;
  EncoderHandle encoder(&options);
  encoder.check(l4d_encoder_set_preset(encoder.get(), preset.c_str()));
  const l4d_gaussians gaussians = scene.view();
  encoder.check(l4d_encoder_set_scene(encoder.get(), &gaussians, &scene.timeline, nullptr));
  encoder.check(l4d_encoder_set_presentation(encoder.get(), &scene.presentation));
  if (weights.gauss_newton) {
    encoder.check(l4d_encoder_set(encoder.get(), L4D_ENC_WEIGHT_METRIC, L4D_ALL_COMPONENTS,
                                  L4D_SENSITIVITY_GAUSS_NEWTON));
  }
  for (const auto& [which, column] : kWeightColumns) {
    const std::vector<float>& values = weights.*column;
    encoder.check(l4d_encoder_set_weights(encoder.get(), which, values.data(), values.size()));
  }
  return encoder;
}

uint64_t encode_scene(const std::string& path, const io::Scene& scene, const io::Weights& weights,
                      const std::string& preset, uint32_t threads) {
  const EncoderHandle encoder = make_encoder(scene, weights, preset, threads);
  encoder.check(l4d_encoder_encode_file(encoder.get(), path.c_str()));
  l4d_encode_report report;
  l4d_encode_report_init(&report);
  encoder.check(l4d_encoder_get_report(encoder.get(), &report));
  return report.file_bytes;
}

io::Image preview_of(const io::Image& captured, const io::Image& rendered) {
  return io::side_by_side({captured, rendered, io::error_map(captured, rendered, kErrorGain)});
}

}  // namespace l4d::train
