// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

#include "io/ply/weights.h"
#include "l4d/l4d.hpp"
#include "training/images/loader.h"
#include "training/model/state.h"
#include "training/run/setup/settings.h"

namespace l4d::train {

// The model as a scene that the codec reads.
io::Scene scene_of(const ModelState& model, const l4d_timeline& timeline);
// The same scene as a model that can be rendered, without what only training needs.
ModelState model_of(const io::Scene& scene);

// The first view that the file states: that of a training camera (io/camera/first_view.h).
l4d_presentation first_view(const Capture& capture, const ImageLoader& loader);
// What a reader of scene.ply gets of it. Text may round the field of view.
l4d_presentation as_read(const l4d_presentation& presentation);

// Pinhole cameras of the images that were trained on: K, w2c, split. Of a moving camera, each image
// has its own.
void write_cameras(const std::string& path, const Capture& capture, const ImageLoader& loader);

// How a run renders what it measures: on the device that trains, the first of several, if one does
// and it is here.
l4d_renderer_options rendering_of(const Settings& settings, uint32_t threads);

// The importance of each Gaussian for the training views (l4d_measure_importance).
io::Weights measure_weights(const io::Scene& scene, const Capture& capture,
                            const ImageLoader& loader, const l4d_renderer_options& rendering,
                            uint64_t seed);

// An encoder of the scene with a preset. It borrows `scene` and `weights`.
EncoderHandle make_encoder(const io::Scene& scene, const io::Weights& weights,
                           const std::string& preset, uint32_t threads);
// Encodes with a preset of the encoder; returns the bytes of the stream.
uint64_t encode_scene(const std::string& path, const io::Scene& scene, const io::Weights& weights,
                      const std::string& preset, uint32_t threads);
// All presets of the encoder: "tiny, small".
std::string preset_names();
// Throws io::Error(INVALID_ARGUMENT) where there is no such preset, and lists those that there are.
void check_preset(const std::string& preset);

// Truth, render and error beside each other.
io::Image preview_of(const io::Image& captured, const io::Image& rendered);

}  // namespace l4d::train
