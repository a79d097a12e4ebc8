// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "eval/image/captured_images.h"
#include "eval/observer.h"
#include "eval/views/rendered_scene.h"
#include "eval/views/views.h"
#include "io/image/image.h"
#include "io/image/metrics.h"

namespace l4d::eval {

// Views that are enough to tell one quality from another.
constexpr size_t kMeterViews = 60;

struct MeterOptions {
  bool captured = false;                          // whether what the cameras saw is needed
  uint64_t max_render_bytes = uint64_t{1} << 30;  // renders of the original that are kept
  io::Hold holder;                                // counts these; none is kept where it refuses
};

// What a coding has of the scene in dB, of mean squared errors, and where it has least.
struct CheckedFidelity {
  double psnr = 0;           // over all views
  double worst_camera = 0;   // over those of one camera
  int camera = 0;            // its id
  double worst_instant = 0;  // over those of one instant, of the instants that most cameras see
  double instant = 0;        // seconds
};
CheckedFidelity checked_fidelity(const CameraViews& views, const std::vector<double>& mse);

// Renders codings of one scene in the same views, and measures how they differ from the scene. The
// images of the scene itself are made once, and kept as far as the memory for them suffices.
class FidelityMeter {
 public:
  // original: must outlive this.
  FidelityMeter(RenderedScene& original, CameraViews views, const MeterOptions& options,
                Observer& observer);
  FidelityMeter(const FidelityMeter&) = delete;
  FidelityMeter& operator=(const FidelityMeter&) = delete;

  const CameraViews& views() const { return views_; }
  size_t num_views() const { return views_.views.size(); }

  // The original's render of a view; good until the next call of anything here.
  const io::Image& original(size_t view);

  // The original's render of a view and the coding's.
  using Visit = std::function<void(size_t view, const io::Image& original, const io::Image& coded)>;
  void visit(RenderedScene& coded, Observer& observer, const Visit& visit);
  CheckedFidelity fidelity(RenderedScene& coded, Observer& observer);
  // Mean over views of the PSNR against what the cameras saw: the scene's less the coding's. Only
  // where captured images were asked for.
  double psnr_loss(RenderedScene& coded, Observer& observer);

 private:
  using Add = std::function<void(size_t view, const io::Image& render, const CapturedImage* seen)>;
  // `seen` is null unless captured images are held.
  void render_all(Observer& observer, RenderedScene& scene, const Add& add);
  double mean_psnr(Observer& observer, RenderedScene& scene);

  CameraViews views_;
  RenderedScene& original_;
  std::vector<std::optional<io::Image>> renders_;  // of the original, by view
  std::shared_ptr<void> render_memory_;
  std::vector<std::vector<size_t>> parts_;  // views whose captured images fit together
  std::optional<CapturedImages> captured_;  // where there is one part
  io::Image again_;                         // of a view whose render is not kept
  double original_psnr_ = 0;                // mean over views
};

}  // namespace l4d::eval
