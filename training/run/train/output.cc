// SPDX-License-Identifier: Apache-2.0
#include "training/run/train/output.h"

#include <nlohmann/json.hpp>
#include <vector>

#include "io/camera/first_view.h"
#include "io/camera/write_cameras.h"
#include "io/file/file.h"
#include "io/scene/rendering_text.h"
#include "l4d/render.hpp"
#include "training/step/cuda_backend.h"

namespace l4d::train {
namespace {

using Json = nlohmann::ordered_json;
using io::Error;

constexpr double kErrorGain = 4;  // in previews

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
  l4d_presentation p = L4D_INIT(l4d_presentation);
  std::vector<l4d_camera> training;
  for (uint32_t c = 0; c < capture.cameras.size(); ++c) {
    if (capture.cameras[c].split == "train") training.push_back(loader.camera(c));
  }
  io::state_first_view(training, frame_of(capture).radius, &p);
  return p;
}

l4d_presentation as_read(const l4d_presentation& presentation) {
  l4d_presentation read = L4D_INIT(l4d_presentation);
  io::parse_presentation(io::presentation_text(presentation), &read);
  return read;
}

void write_cameras(const std::string& path, const Capture& capture, const ImageLoader& loader) {
  io::CameraSet set;
  set.fps = capture.fps;
  set.frames = capture.frames;
  for (uint32_t c = 0; c < capture.cameras.size(); ++c) {
    io::Camera camera;
    camera.id = capture.cameras[c].source.id;
    camera.split = capture.cameras[c].split;
    camera.camera = loader.camera(c);
    set.cameras.push_back(std::move(camera));
  }
  io::write_cameras(path, set);
}

l4d_renderer_options rendering_of(const Settings& settings, uint32_t threads) {
  l4d_renderer_options options = L4D_INIT(l4d_renderer_options);
  options.threads = threads;
  if (settings.backend != "cuda" || !has_cuda_backend()) return options;
  options.backend = L4D_BACKEND_CUDA;
  const std::vector<uint32_t> devices = devices_of(settings.devices);
  if (!devices.empty()) options.device = devices.front();
  return options;
}

io::Weights measure_weights(const io::Scene& scene, const Capture& capture,
                            const ImageLoader& loader, const l4d_renderer_options& rendering,
                            uint64_t seed) {
  std::vector<l4d_camera> cameras;
  for (uint32_t c = 0; c < capture.cameras.size(); ++c) cameras.push_back(loader.camera(c));
  std::vector<l4d_view> views;
  for (const CaptureView& view : capture.views) {
    if (capture.cameras[view.camera].split == "train") views.push_back({view.time, view.camera, 0});
  }
  RendererHandle renderer(&rendering);
  renderer.set_gaussians(scene.view(), scene.timeline);
  l4d_measure_options measure = L4D_INIT(l4d_measure_options);
  measure.metric = L4D_SENSITIVITY_GAUSS_NEWTON;
  measure.seed = seed;
  io::Weights weights;
  weights.gauss_newton = true;
  const auto columns = weights.make_columns(scene.count());
  renderer.check(l4d_measure_importance(
      renderer.get(), cameras.data(), static_cast<uint32_t>(cameras.size()), views.data(),
      views.size(), &measure, columns.data(), scene.count(), nullptr));
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
  l4d_encoder_options options = L4D_INIT(l4d_encoder_options);
  options.threads = threads;
  EncoderHandle encoder(&options);
  encoder.check(l4d_encoder_set_preset(encoder.get(), preset.c_str()));
  const l4d_gaussians gaussians = scene.view();
  encoder.check(l4d_encoder_set_scene(encoder.get(), &gaussians, &scene.timeline, nullptr));
  encoder.check(l4d_encoder_set_presentation(encoder.get(), &scene.presentation));
  const l4d_importance importance = weights.view();
  encoder.check(l4d_encoder_set_importance(encoder.get(), &importance));
  return encoder;
}

uint64_t encode_scene(const std::string& path, const io::Scene& scene, const io::Weights& weights,
                      const std::string& preset, uint32_t threads) {
  const EncoderHandle encoder = make_encoder(scene, weights, preset, threads);
  encoder.check(l4d_encoder_encode_file(encoder.get(), path.c_str()));
  l4d_encode_report report = L4D_INIT(l4d_encode_report);
  encoder.check(l4d_encoder_get_report(encoder.get(), &report));
  return report.file_bytes;
}

io::Image preview_of(const io::Image& captured, const io::Image& rendered) {
  return io::side_by_side({captured, rendered, io::error_map(captured, rendered, kErrorGain)});
}

}  // namespace l4d::train
