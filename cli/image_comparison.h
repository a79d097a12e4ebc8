// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "cli/camera_arguments.h"
#include "cli/common.h"
#include "cli/rendered_scene.h"
#include "io/image.h"

namespace l4d::cli {

// Decibels are reported up to here, which is far beyond what 8 bits show (59 dB): equal images have
// no finite number of them, and JSON has no other.
constexpr double kMaxDecibels = 100;
double capped_psnr(double mse);

// Two images of one view against each other.
struct ImageError {
  double mse = 0;
  double ssim = 0;
};

struct ViewFidelity {
  io::View view;
  int camera = 0;       // id
  ImageError fidelity;  // of B's render against A's
  ImageError a, b;      // of the renders against what the camera saw, where that was asked for
};

struct ImageComparison {
  std::vector<ViewFidelity> views;
  bool has_images = false;
  double render_seconds = 0;

  double fidelity_db() const;  // PSNR of the mean squared error over all views
  size_t worst() const;        // index into views
  Json json(bool per_view) const;
  std::string text(bool per_view) const;
};

// Renders both scenes in all views; all cameras of an instant share it. images: also compares both
// with what the cameras saw.
ImageComparison compare_images(Context& context, RenderedScene& a, RenderedScene& b,
                               const CameraViews& views, bool images);

// A, B and the map of their difference times `gain`, beside each other.
io::Image side_by_side(RenderedScene& a, RenderedScene& b, const CameraViews& views,
                       const io::View& view, double gain);

}  // namespace l4d::cli
