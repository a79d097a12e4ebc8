// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "training/capture/capture.h"

namespace l4d::train {

constexpr double kAuto = -1;

// What decides the result of a training, besides the capture. A checkpoint remembers it.
struct Settings {
  std::string capture;  // path
  CaptureOptions reading;
  double scale = 1;           // of images
  uint64_t gaussians = 0;     // N_max; 0 = from the images and the duration
  uint64_t steps = 0;         // 0 = from the duration, or as many as `seconds` allow
  double seconds = 0;         // > 0: the clock decides when the training ends
  uint32_t views = 0;         // of a step; 0 = 4, or 1 for a moving camera
  std::string init = "auto";  // auto, frustum, hull, or a PLY of points
  uint32_t sh_degree = 3;
  std::string exposure = "auto";             // auto, on, off
  std::string density = "relocate";          // relocate, off
  std::string codec = "off";                 // off, prune
  std::string adam = "dense";                // dense, sparse
  std::string backend = "auto";              // auto, cpu, cuda
  double drift = 2;                          // kappa
  double error_weight = 1;                   // beta
  double near = kAuto;                       // cameras see nothing nearer, in units of their radius
  double opacity_weight = kAuto;             // regularisers: of the mean opacity
  double scale_weight = 0.05;                // of the mean scale, in units of the radius
  double max_scale = 1;                      // of Gaussians, of the radius
  uint64_t host_memory = uint64_t{8} << 30;  // bytes of images
  uint64_t seed = 0;
};

// One line "name value" for each, in a fixed order: what checkpoints compare.
std::string text_of(const Settings& settings);
// Throws io::Error(INVALID_ARGUMENT) where a setting is out of range.
void check(const Settings& settings);
// Settings::near, with the rule for what is auto: 0.2 where cameras look at one place, so that
// nothing is there, else 0.
double near_of(const Settings& settings, const Capture& capture);
// Settings::opacity_weight, with the rule for what is auto. has_alpha: of the images, which then
// are empty for the most part; their mean loss is small, and so is the weight beside it.
double opacity_weight_of(const Settings& settings, bool has_alpha);
// Fills what is 0 or "auto" in, from the capture and the size of its images.
Settings resolved(const Settings& settings, const Capture& capture, uint32_t width,
                  uint32_t height);

}  // namespace l4d::train
