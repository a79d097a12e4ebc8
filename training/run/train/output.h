// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

#include "eval/views/views.h"
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

// Pinhole cameras of the images that were trained on, and the views of a split, "train" or "test",
// in the order of their times. Of a moving camera, each image has its own.
eval::CameraViews views_of(const Capture& capture, const ImageLoader& loader,
                           const std::string& split);

// How a run renders what it measures: on the device that trains, the first of several, if one does
// and it is here.
l4d_renderer_options rendering_of(const Settings& settings, uint32_t threads);

// An encoder of the scene with a preset. It borrows `scene`.
EncoderHandle make_encoder(const io::Scene& scene, const std::string& preset, uint32_t threads);
// All presets of the encoder: "tiny, small".
std::string preset_names();
// Throws io::Error(INVALID_ARGUMENT) where there is no such preset, and lists those that there are.
void check_preset(const std::string& preset);
// Likewise where nothing of the preset follows a quality.
void check_quality(const std::string& preset);

// Truth, render and error beside each other.
io::Image preview_of(const io::Image& captured, const io::Image& rendered);

}  // namespace l4d::train
