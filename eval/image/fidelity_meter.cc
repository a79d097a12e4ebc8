// SPDX-License-Identifier: Apache-2.0
#include "eval/image/fidelity_meter.h"

#include <algorithm>
#include <map>
#include <numeric>
#include <utility>

#include "eval/image/image_comparison.h"

namespace l4d::eval {

CheckedFidelity checked_fidelity(const CameraViews& views, const std::vector<double>& mse) {
  struct Sum {
    double mse = 0;
    size_t views = 0;
    void add(double m) {
      mse += m;
      ++views;
    }
    double psnr() const { return capped_psnr(mse / static_cast<double>(views)); }
  };
  Sum all;
  std::map<size_t, Sum> cameras;
  std::map<double, Sum> instants;
  size_t most = 0;
  for (size_t k = 0; k < mse.size(); ++k) {
    const io::View& view = views.views[k];
    all.add(mse[k]);
    cameras[view.camera].add(mse[k]);
    instants[view.time].add(mse[k]);
    most = std::max(most, instants[view.time].views);
  }
  CheckedFidelity result;
  result.psnr = all.psnr();
  result.worst_camera = result.worst_instant = kMaxDecibels;
  for (const auto& [camera, sum] : cameras) {
    if (sum.psnr() > result.worst_camera) continue;
    result.worst_camera = sum.psnr();
    result.camera = views.set.cameras[camera].id;
  }
  for (const auto& [time, sum] : instants) {
    if (2 * sum.views < most || sum.psnr() > result.worst_instant) continue;
    result.worst_instant = sum.psnr();
    result.instant = time;
  }
  return result;
}

FidelityMeter::FidelityMeter(RenderedScene& original, CameraViews views,
                             const MeterOptions& options, Observer& observer)
    : views_(std::move(views)), original_(original), renders_(views_.views.size()) {
  if (options.captured) {
    parts_ = parts_of(views_);
    if (parts_.size() == 1) captured_.emplace(views_, parts_[0], observer);
    original_psnr_ = mean_psnr(observer, original_);
    return;
  }
  parts_.emplace_back(num_views());
  std::iota(parts_[0].begin(), parts_[0].end(), size_t{0});
  uint64_t bytes = 0;
  for (size_t view = 0; view < num_views(); ++view) {
    const l4d_camera& camera = views_.camera_of(view).camera;
    const uint64_t more = uint64_t{3} * sizeof(float) * camera.width * camera.height;
    if (bytes + more > options.max_render_bytes) break;
    bytes += more;
    renders_[view].emplace();
  }
  try {
    render_memory_ = io::hold(options.holder, bytes, "renders of the scene");
  } catch (const io::Error& error) {
    if (error.status() != L4D_ERR_LIMIT_EXCEEDED) throw;
    renders_.assign(num_views(), std::nullopt);  // each is made again when it is needed
  }
  render_all(observer, original_, [&](size_t view, const io::Image& render, const CapturedImage*) {
    if (renders_[view]) *renders_[view] = render;
  });
}

void FidelityMeter::render_all(Observer& observer, RenderedScene& scene, const Add& add) {
  const bool with_captured = captured_ || parts_.size() > 1;
  io::Image image;
  size_t done = 0;
  for (const std::vector<size_t>& part : parts_) {
    std::optional<CapturedImages> read;
    if (with_captured && !captured_) read.emplace(views_, part, observer);
    for (const size_t view : part) {
      observer.check();
      observer.update(done++, num_views(), "rendering");
      scene.set_time(views_.views[view].time);
      scene.render(views_.camera_of(view).camera, &image);
      if (!with_captured) {
        add(view, image, nullptr);
        continue;
      }
      const CapturedImage seen = (captured_ ? *captured_ : *read).image(view);
      add(view, image, &seen);
    }
  }
}

double FidelityMeter::mean_psnr(Observer& observer, RenderedScene& scene) {
  double sum = 0;
  render_all(observer, scene, [&](size_t, const io::Image& render, const CapturedImage* seen) {
    sum += capped_psnr(io::mse(render, seen->image, seen->mask));
  });
  return sum / static_cast<double>(num_views());
}

const io::Image& FidelityMeter::original(size_t view) {
  if (renders_[view]) return *renders_[view];
  original_.set_time(views_.views[view].time);
  original_.render(views_.camera_of(view).camera, &again_);
  return again_;
}

void FidelityMeter::visit(RenderedScene& coded, Observer& observer, const Visit& visit_view) {
  render_all(observer, coded, [&](size_t view, const io::Image& render, const CapturedImage*) {
    visit_view(view, original(view), render);
  });
}

CheckedFidelity FidelityMeter::fidelity(RenderedScene& coded, Observer& observer) {
  std::vector<double> mse(num_views());
  visit(coded, observer, [&](size_t view, const io::Image& original, const io::Image& render) {
    mse[view] = io::mse(original, render);
  });
  return checked_fidelity(views_, mse);
}

double FidelityMeter::psnr_loss(RenderedScene& coded, Observer& observer) {
  return original_psnr_ - mean_psnr(observer, coded);
}

}  // namespace l4d::eval
