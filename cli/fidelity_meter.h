// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "cli/camera_arguments.h"
#include "cli/captured_images.h"
#include "cli/common.h"
#include "cli/rendered_scene.h"
#include "cli/text/progress.h"
#include "io/image.h"

namespace l4d::cli {

// At most this many of the views, spread evenly over cameras and time.
constexpr size_t kMeterViews = 60;
CameraViews spread_views(CameraViews views, size_t most = kMeterViews);

// Renders streams of one scene in the same views, and tells how they differ from the scene. What
// all of them are held against is made once, and kept as far as memory is meant for it.
class FidelityMeter {
 public:
  // views: not to be changed afterwards. captured: whether what the cameras saw is needed.
  FidelityMeter(Context& context, Progress& progress, const io::Scene& scene,
                const std::string& name, CameraViews views, bool captured);
  FidelityMeter(const FidelityMeter&) = delete;
  FidelityMeter& operator=(const FidelityMeter&) = delete;

  size_t num_views() const { return views_.views.size(); }
  // PSNR of the mean squared error over all views, as ImageComparison::fidelity_db.
  double fidelity(Progress& progress, const std::vector<unsigned char>& stream);
  // Mean over views of the PSNR against what the cameras saw: the scene's less the stream's.
  double psnr_loss(Progress& progress, const std::vector<unsigned char>& stream);

 private:
  using Add = std::function<void(size_t view, const io::Image& render, const io::Image* seen)>;
  // `seen` is null unless captured images are held.
  void render_all(Progress& progress, RenderedScene& scene, const Add& add);
  double mean_psnr(Progress& progress, RenderedScene& scene);
  const io::Camera& camera_of(size_t view) const {
    return views_.set.cameras[views_.views[view].camera];
  }

  Context& context_;
  std::string name_;
  CameraViews views_;
  RenderedScene original_;
  std::vector<std::optional<io::Image>> renders_;  // of the original, by view
  std::vector<std::vector<size_t>> parts_;         // views whose captured images fit together
  std::optional<CapturedImages> captured_;         // where there is one part
  double original_psnr_ = 0;                       // mean over views
};

}  // namespace l4d::cli
