// SPDX-License-Identifier: Apache-2.0
#include "eval/image/image_comparison.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numeric>
#include <optional>

#include "eval/image/captured_images.h"

namespace l4d::eval {
namespace {

double capped(double decibels) { return std::min(decibels, kMaxDecibels); }

}  // namespace

double capped_psnr(double mse) { return capped(io::psnr_of_mse(mse)); }

io::Fidelity summarise(const std::vector<ImageError>& views) {
  io::FidelityAccumulator sums;
  double decibels = 0;
  for (const ImageError& view : views) {
    sums.add(view.mse, view.ssim);
    decibels += capped_psnr(view.mse);
  }
  io::Fidelity result = sums.result();
  result.psnr = capped(result.psnr);
  result.min_psnr = capped(result.min_psnr);
  // One view that is equal must not make the mean of all infinite.
  result.mean_psnr = decibels / static_cast<double>(views.size());
  return result;
}

io::Fidelity ImageComparison::summary(ImageError ViewFidelity::*of) const {
  std::vector<ImageError> errors;
  for (const ViewFidelity& view : views) errors.push_back(view.*of);
  return summarise(errors);
}

double ImageComparison::mean_lpips(ImageError ViewFidelity::*of) const {
  double sum = 0;
  for (const ViewFidelity& view : views) sum += (view.*of).lpips;
  return sum / static_cast<double>(views.size());
}

size_t ImageComparison::worst() const {
  const auto at = std::max_element(
      views.begin(), views.end(),
      [](const ViewFidelity& x, const ViewFidelity& y) { return x.fidelity.mse < y.fidelity.mse; });
  return static_cast<size_t>(at - views.begin());
}

ImageComparison compare_images(RenderedScene& a, RenderedScene& b, const CameraViews& all,
                               bool images, const Lpips* lpips, uint32_t threads,
                               Observer& observer) {
  using Clock = std::chrono::steady_clock;
  std::vector<std::vector<size_t>> parts;
  if (images) {
    parts = parts_of(all);
  } else {
    parts.emplace_back(all.views.size());
    std::iota(parts[0].begin(), parts[0].end(), size_t{0});
  }
  ImageComparison result;
  result.has_images = images;
  if (lpips != nullptr) {
    result.lpips = lpips->network();
    for (const io::View& view : all.views) {
      const l4d_camera& camera = all.set.cameras[view.camera].camera;
      lpips->check_size(camera.width, camera.height);
    }
  }
  result.views.resize(all.views.size());
  const auto error_of = [&](const io::Image& x, const io::Image& y,
                            const std::vector<uint8_t>& mask = {}) {
    const auto distance = [&] {
      return lpips->distance(io::masked(x, mask), io::masked(y, mask), threads);
    };
    return ImageError{io::mse(x, y, mask), io::ssim(x, y, threads, mask),
                      lpips == nullptr ? 0 : distance()};
  };
  io::Image image_a, image_b;
  size_t done = 0;
  for (const std::vector<size_t>& part : parts) {
    std::optional<CapturedImages> captured;
    if (images) captured.emplace(all, part, observer);
    for (const size_t index : part) {
      observer.check();
      observer.update(done++, all.views.size(), "rendering");
      ViewFidelity& out = result.views[index];
      out.view = all.views[index];
      const io::Camera& camera = all.set.cameras[out.view.camera];
      out.camera = camera.id;
      const Clock::time_point begun = Clock::now();
      a.set_time(out.view.time);
      a.render(camera.camera, &image_a);
      b.set_time(out.view.time);
      b.render(camera.camera, &image_b);
      result.render_seconds += std::chrono::duration<double>(Clock::now() - begun).count();
      out.fidelity = error_of(image_a, image_b);
      if (!captured) continue;
      const CapturedImage seen = captured->image(index);
      out.a = error_of(image_a, seen.image, seen.mask);
      out.b = error_of(image_b, seen.image, seen.mask);
    }
  }
  return result;
}

io::Image side_by_side(RenderedScene& a, RenderedScene& b, const CameraViews& views,
                       const io::View& view, double gain) {
  const l4d_camera& camera = views.set.cameras[view.camera].camera;
  io::Image image_a, image_b;
  a.set_time(view.time);
  a.render(camera, &image_a);
  b.set_time(view.time);
  b.render(camera, &image_b);
  const io::Image error = io::error_map(image_a, image_b, gain);
  return io::side_by_side({std::move(image_a), std::move(image_b), error});
}

}  // namespace l4d::eval
