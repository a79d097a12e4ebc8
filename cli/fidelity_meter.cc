// SPDX-License-Identifier: Apache-2.0
#include "cli/fidelity_meter.h"

#include <algorithm>
#include <numeric>

#include "cli/image_comparison.h"
#include "io/metrics.h"

namespace l4d::cli {
namespace {

// Renders of the original that are kept, and captured images in memory at a time.
constexpr uint64_t kMaxRenderBytes = uint64_t{1} << 30;
constexpr uint64_t kMaxCapturedBytes = uint64_t{1} << 30;

}  // namespace

CameraViews spread_views(CameraViews all, size_t most) {
  std::vector<io::View>& views = all.views;
  if (views.size() <= most) return all;
  // By camera, so that even steps do not meet the same cameras again and again.
  const auto by_camera = [](const io::View& x, const io::View& y) {
    return x.camera != y.camera ? x.camera < y.camera : x.time < y.time;
  };
  std::stable_sort(views.begin(), views.end(), by_camera);
  std::vector<io::View> chosen;
  for (size_t k = 0; k < most; ++k) {
    chosen.push_back(views[(2 * k + 1) * views.size() / (2 * most)]);
  }
  // Cameras of an instant share the scene as it is then.
  std::stable_sort(chosen.begin(), chosen.end(),
                   [](const io::View& x, const io::View& y) { return x.time < y.time; });
  views = std::move(chosen);
  return all;
}

FidelityMeter::FidelityMeter(Context& context, Progress& progress, const io::Scene& scene,
                             const std::string& name, CameraViews views, bool captured)
    : context_(context),
      name_(name),
      views_(std::move(views)),
      original_(context, scene, name),
      renders_(views_.views.size()) {
  if (captured) {
    parts_ = parts_of(views_, kMaxCapturedBytes);
    if (parts_.size() == 1) captured_.emplace(views_, parts_[0], progress);
    original_psnr_ = mean_psnr(progress, original_);
    return;
  }
  parts_.emplace_back(num_views());
  std::iota(parts_[0].begin(), parts_[0].end(), size_t{0});
  uint64_t bytes = 0;
  for (size_t view = 0; view < num_views(); ++view) {
    const l4d_camera& camera = camera_of(view).camera;
    bytes += uint64_t{3} * sizeof(float) * camera.width * camera.height;
    if (bytes > kMaxRenderBytes) break;
    renders_[view].emplace();
  }
  render_all(progress, original_, [&](size_t view, const io::Image& render, const io::Image*) {
    if (renders_[view]) *renders_[view] = render;
  });
}

void FidelityMeter::render_all(Progress& progress, RenderedScene& scene, const Add& add) {
  const bool with_captured = captured_ || parts_.size() > 1;
  io::Image image;
  size_t done = 0;
  for (const std::vector<size_t>& part : parts_) {
    std::optional<CapturedImages> read;
    if (with_captured && !captured_) read.emplace(views_, part, progress);
    for (const size_t view : part) {
      progress.update(done++, num_views(), "rendering");
      scene.set_time(views_.views[view].time);
      scene.render(camera_of(view).camera, &image);
      if (!with_captured) {
        add(view, image, nullptr);
        continue;
      }
      const io::Image seen = (captured_ ? *captured_ : *read).image(view);
      add(view, image, &seen);
    }
  }
}

double FidelityMeter::mean_psnr(Progress& progress, RenderedScene& scene) {
  double sum = 0;
  render_all(progress, scene, [&](size_t, const io::Image& render, const io::Image* seen) {
    sum += capped_psnr(io::mse(render, *seen));
  });
  return sum / static_cast<double>(num_views());
}

double FidelityMeter::fidelity(Progress& progress, const std::vector<unsigned char>& stream) {
  RenderedScene coded(context_, stream, name_);
  io::Image again;
  double sum = 0;
  render_all(progress, coded, [&](size_t view, const io::Image& render, const io::Image*) {
    if (!renders_[view]) {
      original_.set_time(views_.views[view].time);
      original_.render(camera_of(view).camera, &again);
    }
    sum += io::mse(render, renders_[view] ? *renders_[view] : again);
  });
  return capped_psnr(sum / static_cast<double>(num_views()));
}

double FidelityMeter::psnr_loss(Progress& progress, const std::vector<unsigned char>& stream) {
  RenderedScene coded(context_, stream, name_);
  return original_psnr_ - mean_psnr(progress, coded);
}

}  // namespace l4d::cli
