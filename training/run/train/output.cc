// SPDX-License-Identifier: Apache-2.0
#include "training/run/train/output.h"

#include <algorithm>
#include <vector>

#include "eval/target/encoding.h"
#include "io/camera/first_view.h"
#include "io/file/file.h"
#include "io/scene/rendering_text.h"
#include "l4d/render.hpp"
#include "training/step/cuda_backend.h"

namespace l4d::train {
namespace {

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

eval::CameraViews views_of(const Capture& capture, const ImageLoader& loader,
                           const std::string& split) {
  eval::CameraViews all;
  all.set.fps = capture.fps;
  all.set.frames = capture.frames;
  for (uint32_t c = 0; c < capture.cameras.size(); ++c) {
    io::Camera camera;
    camera.id = capture.cameras[c].source.id;
    camera.split = capture.cameras[c].split;
    camera.camera = loader.camera(c);
    all.set.cameras.push_back(std::move(camera));
  }
  for (uint32_t k = 0; k < capture.views.size(); ++k) {
    const uint32_t camera = capture.views[k].camera;
    if (capture.cameras[camera].split != split) continue;
    all.views.push_back({camera, capture.time_of(k), 0});
  }
  std::stable_sort(all.views.begin(), all.views.end(), [](const io::View& x, const io::View& y) {
    return x.time != y.time ? x.time < y.time : x.camera < y.camera;
  });
  return all;
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

std::string preset_names() {
  std::string names;
  for (const std::string& name : EncoderHandle::preset_names()) {
    names += (names.empty() ? "" : ", ") + name;
  }
  return names;
}

void check_preset(const std::string& preset) {
  const std::vector<std::string> known = EncoderHandle::preset_names();
  if (std::find(known.begin(), known.end(), preset) != known.end()) return;
  throw Error(L4D_ERR_INVALID_ARGUMENT,
              "--encode is " + preset + "; it must be a preset of the encoder: " + preset_names());
}

void check_quality(const std::string& preset) {
  check_preset(preset);
  const EncoderHandle encoder;
  encoder.check(l4d_encoder_set_preset(encoder.get(), preset.c_str()));
  if (eval::has_quality(encoder)) return;
  throw Error(L4D_ERR_INVALID_ARGUMENT,
              "--encode is " + preset + ", of which nothing follows a size or a quality");
}

EncoderHandle make_encoder(const io::Scene& scene, const std::string& preset, uint32_t threads) {
  l4d_encoder_options options = L4D_INIT(l4d_encoder_options);
  options.threads = threads;
  EncoderHandle encoder(&options);
  encoder.check(l4d_encoder_set_preset(encoder.get(), preset.c_str()));
  const l4d_gaussians gaussians = scene.view();
  encoder.check(l4d_encoder_set_scene(encoder.get(), &gaussians, &scene.timeline, nullptr));
  encoder.check(l4d_encoder_set_presentation(encoder.get(), &scene.presentation));
  return encoder;
}

io::Image preview_of(const io::Image& captured, const io::Image& rendered) {
  return io::side_by_side({captured, rendered, io::error_map(captured, rendered, kErrorGain)});
}

}  // namespace l4d::train
