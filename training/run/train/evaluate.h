// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "eval/image/lpips.h"
#include "eval/jod/jod.h"
#include "io/image/image.h"
#include "io/image/metrics.h"
#include "training/images/loader.h"

namespace l4d::train {

// The views of a split, at most `frames` instants of them, spread evenly; 0 = all.
std::vector<uint32_t> views_to_score(const Capture& capture, const char* split, uint32_t frames);

// At most `count` views of a split: instants spread evenly, and all cameras about equally often.
std::vector<uint32_t> views_to_watch(const Capture& capture, const char* split, size_t count);

struct CameraScore {
  std::string name;
  uint64_t views = 0;
  double psnr = 0, min_psnr = 0;  // mean over views; of the worst
  double psnr_affine = 0;         // as that of Score
  double jod = std::nan("");      // NaN: not measured, or its views are no video
};

struct WorstView {
  std::string camera;
  uint32_t frame = 0;
  double time = 0;  // s
  double psnr = 0;
  std::string beside;  // a PNG of what was captured and what was rendered, small
};

struct Score {
  io::Fidelity plain;
  // After the affine map of colours of each view that fits best: how much of the error is exposure.
  double psnr_affine = 0;
  double lpips = 0;           // mean over views; of Scorer's network, if it has one
  double jod = std::nan("");  // mean over cameras; NaN: one has none
  // Of score_views():
  std::vector<CameraScore> cameras;  // that have views, in the order of the capture
  std::vector<WorstView> worst;      // three at most, the worst first
};

// Adds views up. Images with alpha are compared on a background, by the pixels that the mask of a
// camera leaves; LPIPS sees black elsewhere. SSIM is NaN for images of less than 11 pixels.
class Scorer {
 public:
  // lpips: may be null; else it must outlive this.
  explicit Scorer(const eval::Lpips* lpips = nullptr, const Colour& background = {},
                  bool measures_jod = false)
      : lpips_(lpips), background_(background), measures_jod_(measures_jod) {}
  struct Psnr {
    double plain, affine;
  };
  // mask: [height, width] or empty. Returns those of the view.
  Psnr add(const Pixels& captured, const std::vector<uint8_t>& mask, const io::Image& rendered,
           uint32_t threads);
  Score score() const;
  const Colour& background() const { return background_; }
  bool measures_jod() const { return measures_jod_; }  // by score_views()

 private:
  io::FidelityAccumulator sum_;
  double affine_ = 0, distance_ = 0;
  const eval::Lpips* lpips_;
  Colour background_;
  bool measures_jod_;
};

// Training cameras that a scene shows much worse than the others, whatever their colours: their
// place, lens or clock may be wrong. One sentence each.
std::vector<std::string> notes_of_cameras(const Score& train);

using RenderView = std::function<io::Image(uint32_t view)>;
using IsCancelled = std::function<bool()>;

// Reads the views, a part of them at a time, and hands them out in their order on one thread.
// cancelled: may be null. Throws io::Error: CANCELLED, or what is wrong with an image.
void for_each_image(const ImageLoader& loader, const std::vector<uint32_t>& views, uint32_t threads,
                    const std::function<void(uint32_t view, const Pixels& pixels)>& visit,
                    const IsCancelled& cancelled);

// Reads the views, renders them and compares. cancelled: may be null. render: called on one thread,
// with the background of the scorer. JOD is that of the videos that the views of each camera are,
// at the usual display (eval/jod/jod.h), with the pixels that a mask leaves.
Score score_views(const Capture& capture, const ImageLoader& loader,
                  const std::vector<uint32_t>& views, Scorer scorer, uint32_t threads,
                  const RenderView& render, const IsCancelled& cancelled);

// Reads the weights of LPIPS; nothing if `path` is empty. Throws io::Error.
std::unique_ptr<eval::Lpips> read_lpips(const std::string& path, const io::Hold& holder = {});
// Throws io::Error if images of a capture are too small for the network. lpips: may be null.
void check_sizes(const eval::Lpips* lpips, const Capture& capture, const ImageLoader& loader);

}  // namespace l4d::train
