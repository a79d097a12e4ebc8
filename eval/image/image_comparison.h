// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "eval/image/lpips.h"
#include "eval/jod/jod.h"
#include "eval/observer.h"
#include "eval/views/rendered_scene.h"
#include "eval/views/views.h"
#include "io/image/image.h"
#include "io/image/metrics.h"

namespace l4d::eval {

// Decibels are reported up to here, which is far beyond what 8 bits show (59 dB): equal images have
// no finite number of them, and JSON has no other.
constexpr double kMaxDecibels = 100;
double capped_psnr(double mse);

// Two images of one view against each other.
struct ImageError {
  double mse = 0;
  double ssim = 0;
  double lpips = 0;  // where a network measured it
};

// Over all views; none of its decibels is above kMaxDecibels.
io::Fidelity summarise(const std::vector<ImageError>& views);

struct ViewFidelity {
  io::View view;
  int camera = 0;       // id
  ImageError fidelity;  // of B's render against A's
  ImageError a, b;      // of the renders against what the camera saw, if the caller wants it
};

// The videos that a camera makes of its views.
struct CameraJod {
  int camera = 0;       // id
  uint64_t frames = 0;  // 1: an image
  double fps = 0;       // of the chosen frames; 0: an image
  double jod = 0;       // of B's against A's
  double a = 0, b = 0;  // against what the camera saw, if the caller wants it
};

struct ImageComparison {
  std::vector<ViewFidelity> views;
  bool has_images = false;
  const JodDisplay* display = nullptr;  // of JOD; null = it was not measured
  std::vector<CameraJod> jods;          // by camera
  std::string lpips;                    // the network of LPIPS, "alex" or "vgg"; "" = none
  double render_seconds = 0;

  // Of one of the errors that views have: &ViewFidelity::fidelity, a or b.
  io::Fidelity summary(ImageError ViewFidelity::*of) const;
  double mean_lpips(ImageError ViewFidelity::*of) const;
  double mean_jod(double CameraJod::*of) const;
  double min_jod() const;  // of the camera whose video of B is worst against A's
  size_t worst() const;    // index into views
};

// Renders both scenes in all views; all cameras of an instant share it. images: also compares both
// with what the cameras saw. lpips: may be null; throws io::Error before it renders if images are
// too small for the network. display: where JOD is to be measured, null = nowhere; then the views
// of each camera are a video, whose frames must be evenly spaced (INVALID_ARGUMENT before
// rendering), and cameras follow each other. threads: 0 = one per core.
ImageComparison compare_images(RenderedScene& a, RenderedScene& b, const CameraViews& views,
                               bool images, const Lpips* lpips, uint32_t threads,
                               Observer& observer, const JodDisplay* display = nullptr);

// A, B and the map of their difference times `gain`, beside each other.
io::Image side_by_side(RenderedScene& a, RenderedScene& b, const CameraViews& views,
                       const io::View& view, double gain);

}  // namespace l4d::eval
